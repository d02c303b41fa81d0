"""Local relief: bumps are positive, dents negative, form and tilt are removed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from classify import InputError, integrate_gradients, local_relief

# of a Gaussian at half its height, in standard deviations
FULL_WIDTH = 2 * np.sqrt(2 * np.log(2))


def hump(rows: int, columns: int, at: tuple[float, float], width_px: float) -> np.ndarray:
    y, x = np.arange(rows)[:, None] - at[0], np.arange(columns)[None, :] - at[1]
    return np.exp(-(x * x + y * y) / (2 * width_px**2))


def test_a_bump_is_raised_and_a_dent_indented_on_a_tilted_bent_part() -> None:
    """From gradients alone, as in the whole chain."""
    shape = (120, 160)
    x, y = np.meshgrid(np.arange(160) - 80.0, 60.0 - np.arange(120))
    bump, dent = hump(*shape, (40, 50), 5.0), hump(*shape, (80, 110), 5.0)
    height = 3 * bump - 2 * dent + 0.3 * x - 0.1 * y - 0.001 * x * x
    q, p = np.gradient(height)
    found = integrate_gradients(p.astype(np.float32), -q.astype(np.float32))
    relief = local_relief(found, cutoff_px=4 * FULL_WIDTH * 5.0)
    assert relief.dtype == np.float32
    assert relief[40, 50] == pytest.approx(0.76 * 3.0, rel=0.1)
    assert relief[80, 110] == pytest.approx(0.76 * -2.0, rel=0.1)
    middle = np.s_[20:-20, 20:-20]
    where = np.unravel_index([relief[middle].argmax(), relief[middle].argmin()], (80, 120))
    assert [(r + 20, c + 20) for r, c in zip(*where, strict=True)] == [(40, 50), (80, 110)]


def test_a_wave_of_the_cutoff_is_halved_and_shorter_ones_are_kept() -> None:
    """Cosines that end with the frame, so that mirroring continues them."""
    x = np.arange(400) + 0.5
    for wavelength_px, share in ((50.0, 0.5), (100.0, 1 - 0.5**0.25), (10.0, 1.0)):
        wave = np.tile(np.cos(2 * np.pi * x / wavelength_px), (8, 1)).astype(np.float32)
        found = local_relief(wave, cutoff_px=50.0)
        np.testing.assert_allclose(found, share * wave, atol=1e-4)
        np.testing.assert_allclose(local_relief(wave.T, cutoff_px=50.0), found.T, atol=1e-5)


def test_the_default_cutoff_is_a_fifth_of_the_longer_side() -> None:
    height = np.random.default_rng(0).standard_normal((30, 100)).astype(np.float32)
    np.testing.assert_array_equal(local_relief(height), local_relief(height, cutoff_px=20.0))


@settings(deadline=None)
@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 20), st.integers(1, 20)),
        elements=st.floats(-100, 100, width=32),
    ),
    st.floats(-50, 50, width=32),
)
def test_relief_rotates_with_the_surface_and_ignores_an_offset(
    height: np.ndarray, raised_by: float
) -> None:
    relief = local_relief(height)
    tolerance = 1e-4 * (1 + np.abs(height).max() + abs(raised_by))
    np.testing.assert_allclose(local_relief(np.rot90(height)), np.rot90(relief), atol=tolerance)
    np.testing.assert_allclose(local_relief(-height), -relief, atol=tolerance)
    np.testing.assert_allclose(local_relief(height + raised_by), relief, atol=tolerance)
    assert abs(float(relief.mean())) < tolerance


def test_invalid_pixels_have_no_relief() -> None:
    height = np.random.default_rng(1).standard_normal((20, 30)).astype(np.float32)
    valid = height > 0
    relief = local_relief(height, valid)
    assert (relief[~valid] == 0).all()
    np.testing.assert_array_equal(relief[valid], local_relief(height)[valid])


def test_unusable_input_is_named() -> None:
    height = np.zeros((4, 5), np.float32)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="cutoff_px is"):
            local_relief(height, cutoff_px=bad)
    for shape in ((5,), (0, 5)):
        with pytest.raises(InputError, match="must be"):
            local_relief(np.zeros(shape, np.float32))
    height[1, 2] = np.nan
    with pytest.raises(InputError, match="NaN"):
        local_relief(height)
