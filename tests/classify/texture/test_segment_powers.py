"""Powers of segments, against plain transforms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify.base.threads import set_thread_count
from classify.texture.fields import TextureFields
from classify.texture.segment_powers import _circular_hann, _starts, segment_powers
from classify.texture.spectra import MIN_SEGMENT_PX


def noise_fields(shape: tuple[int, int]) -> TextureFields:
    p, q, albedo = np.random.default_rng(0).normal(0.1, 0.2, (3, *shape)).astype(np.float32)
    return TextureFields(p, q, 1 + albedo)


def plain_powers(fields: TextureFields, side: int) -> np.ndarray:
    """(6, side, side // 2 + 1) by the definition, segment by segment."""
    window = _circular_hann(side).astype(float)
    segments = []
    for row in _starts(fields.shape[0], side):
        for column in _starts(fields.shape[1], side):
            transforms = []
            for plane in (fields.p, fields.q, fields.albedo):
                part = plane[row : row + side, column : column + side].astype(float)
                part = part - (part * window).sum() / window.sum()
                transforms.append(np.fft.rfft2(part * window))
            p, q, a = transforms
            gradient, difference = abs(p) ** 2 + abs(q) ** 2, abs(p) ** 2 - abs(q) ** 2
            product = 2 * (p * q.conj()).real
            with_albedo = (p * a.conj()).imag, (q * a.conj()).imag
            segments.append([gradient, difference, product, abs(a) ** 2, *with_albedo])
    return np.mean(segments, axis=0) / np.square(window).sum()


@pytest.mark.parametrize(
    ("shape", "side"),
    # One segment, an odd and an even number of them, an odd side, enough for threads.
    [((32, 32), 32), ((70, 80), 32), ((64, 80), 32), ((80, 80), 65), ((200, 330), 128)],
)
def test_powers_are_those_of_plain_transforms(shape: tuple[int, int], side: int) -> None:
    fields = noise_fields(shape)
    found = np.moveaxis(segment_powers(fields, side), 1, 0)
    expected = plain_powers(fields, side)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4 * expected[0].mean())


def test_threads_change_no_digit() -> None:
    fields = noise_fields((300, 260))
    powers = []
    for threads in (1, 3):
        set_thread_count(threads)
        powers.append(segment_powers(fields, 128))
    np.testing.assert_array_equal(*powers)


def test_a_view_of_a_plane_gives_the_powers_of_its_copy() -> None:
    whole = noise_fields((150, 160))
    cut = np.s_[20:120, 30:150]
    view = TextureFields(whole.p[cut], whole.q[cut], whole.albedo[cut])
    copy = TextureFields(view.p.copy(), view.q.copy(), view.albedo.copy())
    np.testing.assert_array_equal(segment_powers(view, 64), segment_powers(copy, 64))


@given(st.integers(MIN_SEGMENT_PX, 4000), st.sampled_from([32, 64, 128, 256]))
def test_segments_cover_the_length_and_overlap_by_half(length: int, side: int) -> None:
    length = max(length, side)
    starts = _starts(length, side)
    assert [length - side - start for start in starts[::-1]] == starts
    assert starts[0] == 0
    assert starts[-1] == length - side
    assert (np.diff(starts) > 0).all()
    assert (np.diff(starts) <= side // 2).all()
