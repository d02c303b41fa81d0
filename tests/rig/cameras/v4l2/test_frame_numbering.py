"""Frames are numbered by their time stamps."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import CameraError
from rig.cameras.v4l2.camera import FrameNumbering, V4l2Camera
from rig.cameras.v4l2.device import Capture

OPENED_S = 1000.0


@given(
    steps=st.lists(st.integers(1, 500), min_size=1, max_size=50),
    rate_hz=st.floats(0.5, 1000.0),
    first_s=st.floats(1e-5, 10.0),
)
def test_each_period_has_the_next_number(steps: list[int], rate_hz: float, first_s: float) -> None:
    # Period and stamps are rounded as in a driver.
    frames = FrameNumbering(OPENED_S, round(1e9 / rate_hz) / 1e9)
    number, numbers, assigned = 0, [], []
    for step in (0, *steps):
        number += step
        numbers.append(number)
        assigned.append(frames.number_of(round(OPENED_S + first_s + number / rate_hz, 6)))
    assert assigned == numbers


def test_a_repeated_frame_keeps_its_number() -> None:
    frames = FrameNumbering(OPENED_S, 0.1)
    assert [frames.number_of(stamp_s) for stamp_s in (1000.5, 1000.6, 1000.6)] == [0, 1, 1]


@given(part=st.floats(0.02, 0.98))
def test_a_stamp_from_the_opening_or_between_two_frames_has_no_number(part: float) -> None:
    frames = FrameNumbering(OPENED_S, 0.1)
    stamps = (OPENED_S - 0.1 * part, OPENED_S, 1000.1, 1000.2 + 0.1 * part, 1000.4)
    assert [frames.number_of(stamp_s) for stamp_s in stamps] == [None, None, 0, None, 3]


def test_frames_without_a_number_do_not_extend_the_time_out() -> None:
    timeouts_s = []

    class Device:
        def next_capture(self, timeout_s: float) -> Capture:
            timeouts_s.append(timeout_s)
            if len(timeouts_s) == 3:
                raise CameraError("no frame")
            time.sleep(0.05)
            return Capture(bytearray(), False, OPENED_S, True, False, 0)

    camera = V4l2Camera.__new__(V4l2Camera)
    camera._device = Device()  # type: ignore[assignment]
    camera._numbering = FrameNumbering(OPENED_S, 0.1)
    with pytest.raises(CameraError, match="no frame"):
        camera.read(60.0)
    assert timeouts_s[1] <= 59.95
    assert timeouts_s[2] <= 59.90


def test_frames_out_of_step_with_their_writer_are_no_silence() -> None:
    class Device:
        path = "/dev/video9"

        def next_capture(self, timeout_s: float) -> Capture:
            time.sleep(min(timeout_s, 0.02))
            if timeout_s < 0.02:
                raise CameraError(f"no frame in {timeout_s:g} s")
            return Capture(bytearray(), False, OPENED_S, True, False, 0)

    camera = V4l2Camera.__new__(V4l2Camera)
    camera._device, camera._period_s = Device(), 0.1  # type: ignore[assignment]
    camera._numbering = FrameNumbering(OPENED_S, 0.1)
    with pytest.raises(CameraError, match=r"0.05 s none .* 10 Hz"):
        camera.read(0.05)
