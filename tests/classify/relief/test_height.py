"""Height from gradients without the assumption of a periodic frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from classify import InputError, integrate_gradients


def half_pixel_gradients(height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes p and q whose means between neighbours are the differences of `height`.

    Started at zero on the first pixel: p[i + 1] = 2 d[i] - p[i], in float64 to keep it exact.
    """

    def along_last(difference: np.ndarray) -> np.ndarray:
        count = difference.shape[-1]
        signs = (-1.0) ** np.arange(count)
        summed = np.cumsum(2.0 * difference * signs, axis=-1)
        out = np.zeros((*difference.shape[:-1], count + 1))
        out[..., 1:] = summed * signs
        return out

    p = along_last(np.diff(height, axis=1))
    q = -along_last(np.diff(height, axis=0).T).T
    return p, q


@given(st.integers(1, 24), st.integers(1, 24), st.integers(0, 2**32 - 1))
def test_random_height_is_recovered_from_its_differences(
    rows: int, columns: int, seed: int
) -> None:
    height = np.random.default_rng(seed).standard_normal((rows, columns))
    p, q = half_pixel_gradients(height)
    found = integrate_gradients(p.astype(np.float32), q.astype(np.float32))
    assert found.shape == (rows, columns)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, height - height.mean(), atol=2e-4)


@pytest.mark.parametrize("shape", [(64, 64), (40, 96), (1, 50), (50, 1), (1024, 700), (2, 6000)])
def test_a_plane_is_recovered_at_any_frame_size(shape: tuple[int, int]) -> None:
    rows, columns = shape
    slope_x, slope_y = 0.3, -0.2
    ones = np.ones(shape, np.float32)
    found = integrate_gradients(slope_x * ones, slope_y * ones)
    x = np.arange(columns) - (columns - 1) / 2
    y = (rows - 1) / 2 - np.arange(rows)
    plane = slope_x * x + slope_y * y[:, None]
    np.testing.assert_allclose(found, plane, atol=2e-4 * np.abs(plane).max())


def test_curl_does_not_change_the_height() -> None:
    """A rotation field added to a plane changes nothing in the middle."""
    x = np.arange(65, dtype=np.float32) - 32
    p = np.tile(0.01 * x[:, None], (1, 65)) + 0.2  # rows: x[:, None] is -y
    q = np.tile(0.01 * x, (65, 1))
    found = integrate_gradients(p, q)
    assert found[32, 48] - found[32, 16] == pytest.approx(0.2 * 32, rel=0.01)


def test_a_crop_that_is_not_periodic_is_integrated_well() -> None:
    rows, columns = 120, 150
    x = np.arange(columns)[None, :] / columns
    y = 1.0 - np.arange(rows)[:, None] / rows
    height = 12 * x * x + 6 * x * y + 5 * np.sin(4 * x + 5 * y)
    p = (24 * x + 6 * y + 20 * np.cos(4 * x + 5 * y)) / columns
    q = (6 * x + 25 * np.cos(4 * x + 5 * y)) / rows
    truth = height - height.mean()
    found = integrate_gradients(p.astype(np.float32), q.astype(np.float32))
    assert (found - truth).std() < 0.01 * truth.std()


def test_unusable_gradients_are_named() -> None:
    ones = np.ones((4, 5), np.float32)
    for p, q in ((ones, ones.T), (ones[0], ones[0]), (ones[:0], ones[:0])):
        with pytest.raises(InputError, match="both must be"):
            integrate_gradients(p, q)
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match="NaN or infinity"):
            integrate_gradients(ones, np.where(ones == 1, bad, ones).astype(np.float32))


@pytest.mark.parametrize("shape", ["disc", "ring", "scattered"])
def test_slopes_of_pixels_that_are_not_valid_have_no_weight(shape: str) -> None:
    rng = np.random.default_rng(5)
    truth = gaussian_filter(rng.standard_normal((120, 160)), 8.0) * 100.0
    y, x = np.mgrid[:120, :160]
    radius = np.hypot(x - 70, y - 60)
    valid = {
        "disc": radius < 40, "ring": (radius > 35) & (radius < 45),
        "scattered": rng.random(truth.shape) > 0.3,
    }[shape]  # fmt: skip
    p, q = np.gradient(truth, axis=1), -np.gradient(truth, axis=0)
    known = [np.where(valid, slope, 0.0).astype(np.float32) for slope in (p, q)]
    error = (integrate_gradients(*known, valid) - truth)[valid]
    assert error.std() < 0.005 * np.ptp(truth[valid])
    ignored = [np.where(valid, slope, 9.0).astype(np.float32) for slope in (p, q)]
    np.testing.assert_array_equal(
        integrate_gradients(*ignored, valid), integrate_gradients(*known, valid)
    )


def test_no_valid_pixel_gives_a_level_height() -> None:
    slope = np.ones((4, 5), np.float32)
    assert not integrate_gradients(slope, slope, np.zeros((4, 5), np.bool_)).any()
