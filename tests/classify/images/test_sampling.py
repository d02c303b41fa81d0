"""Samples of a frame, which must not prefer a side or a direction."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from classify.images import sample_pixels, symmetric_samples

sizes = st.integers(0, 400)


@given(sizes, st.integers(1, 50))
def test_samples_are_symmetric_and_evenly_spread(size: int, step: int) -> None:
    samples = symmetric_samples(size, step)
    np.testing.assert_array_equal(samples, size - 1 - samples[::-1])
    gaps = np.diff(samples)
    assert (gaps <= step).all()
    assert np.count_nonzero(gaps != step) <= 1
    if size:
        assert samples[0] < step


@given(st.integers(0, 60), st.integers(0, 60), st.integers(1, 500), st.integers(0, 3))
def test_samples_of_a_rotated_or_mirrored_frame_are_the_same_pixels(
    rows: int, columns: int, most: int, margin: int
) -> None:
    frame = np.arange(rows * columns).reshape(rows, columns)
    sampled = np.isin(frame, sample_pixels(frame.shape, most, margin))
    inside = frame[margin : rows - margin, margin : columns - margin] if margin else frame
    assert np.isin(frame[sampled], inside).all()
    assert sampled.any() == (inside.size > 0)
    assert sampled.sum() <= (np.sqrt(most) + 2) * (np.sqrt(most) + max(rows, columns))
    for other in (np.rot90(frame), np.flipud(frame), frame.T):
        pixels = sample_pixels(other.shape, most, margin)
        np.testing.assert_array_equal(np.isin(frame, other.ravel()[pixels]), sampled)
