"""Repeats and exposure times of the frames of one attempt."""

import numpy as np
import pytest

from capture import SetRejected
from capture.acquisition.fresh_frames import ExposureTimeline, RepeatDetector
from rig import Frame

NOISY, OTHER = np.random.default_rng(1).integers(0, 255, (2, 8, 8), dtype=np.uint8)
EVEN = np.zeros((8, 8), np.uint8)


@pytest.mark.parametrize(
    ("sequences", "images", "repeats"),
    [
        ([1, 2, 4], [NOISY, OTHER, NOISY], [False, False, False]),
        ([1, 1, 2], [NOISY, OTHER, NOISY], [False, True, False]),
        ([1, 2, 3, 4], [NOISY, NOISY, NOISY, OTHER], [False, True, False, False]),
        ([1, 2], [EVEN, EVEN], [False, False]),
    ],
    ids=["different", "number", "static scene", "even"],
)
def test_a_repeat_has_the_number_or_the_pixels_of_the_last_frame(sequences, images, repeats):
    detector = RepeatDetector()
    frames = [Frame(p, 8, 0.0, 0.0, n) for p, n in zip(images, sequences, strict=True)]
    assert [detector.is_repeat(frame) for frame in frames] == repeats


@pytest.mark.parametrize(
    ("not_before_s", "known_to_s", "max_frames", "start_s"),
    [
        (10.05, 0.0, 3, 10.101),  # the period may be 1 % longer
        (10.15, 0.0, 3, 10.202),
        (10.15, 0.0, 1, None),  # too many frames ahead
        (10.15, 0.06, 3, None),  # the frame at 10.1 s may be the first, too
        (9.0, 0.02, 3, 10.121),
    ],
)
def test_the_next_start_is_predicted_from_the_last_frame(
    not_before_s, known_to_s, max_frames, start_s
):
    timeline = ExposureTimeline(0.1)
    assert timeline.next_start_s(not_before_s, known_to_s, max_frames) is None
    timeline.add(10.0)
    predicted = timeline.next_start_s(not_before_s, known_to_s, max_frames)
    assert predicted == (None if start_s is None else pytest.approx(start_s))


def test_an_early_stamp_is_corrected_by_the_period():
    timeline = ExposureTimeline(0.1)
    timeline.add(10.0)
    timeline.add(10.02)
    assert timeline.last_start_s == pytest.approx(10.099)


def test_a_late_stamp_is_found_by_those_of_later_frames():
    timeline = ExposureTimeline(0.1)
    timeline.add(10.09)  # in truth 10.0
    timeline.accept(10.05, "LED 1")
    with pytest.raises(SetRejected, match=r"LED 1 was late: .* 49 ms"):
        timeline.add(10.1)
