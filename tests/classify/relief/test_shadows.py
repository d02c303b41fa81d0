"""Cast shadows against a ray march and geometry, and rotated."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation, binary_erosion, map_coordinates

from classify.base.errors import InputError
from classify.lighting import light_vectors
from classify.relief.relighting import cast_shadow
from rig.scene.synthetic import synthetic_surface


def marched(height: np.ndarray, light: np.ndarray, step_px: float = 0.25) -> np.ndarray:
    """March along the ray of every pixel in small steps, on bilinear heights."""
    rows, cols = np.mgrid[: height.shape[0], : height.shape[1]].astype(float)
    across = np.hypot(light[0], light[1])
    shadow = np.zeros(height.shape, bool)
    # Beyond this a ray is above the highest point.
    reach_px = min(np.ptp(height) * across / light[2], 1.5 * max(height.shape))
    for d in np.arange(step_px, reach_px + step_px, step_px):
        r, c = rows - d * light[1] / across, cols + d * light[0] / across
        inside = (r >= 0) & (r <= height.shape[0] - 1) & (c >= 0) & (c <= height.shape[1] - 1)
        z = map_coordinates(height, [r, c], order=1, mode="nearest")
        shadow |= inside & (z > height + d * light[2] / across + 1e-3)
    return shadow


@pytest.fixture(scope="module")
def sand() -> np.ndarray:
    return synthetic_surface("sand", seed=1, tile_px=512).height[:80, :80]


@pytest.mark.parametrize("tilt_deg", [0, 90, 180, 270, 17, 45, 130, 200, 300])
@pytest.mark.parametrize("slant_deg", [50, 65])
def test_sweep_agrees_with_ray_march(sand: np.ndarray, tilt_deg: int, slant_deg: int) -> None:
    light = light_vectors(tilt_deg, slant_deg)
    swept, exact = cast_shadow(sand, light), marched(sand.astype(float), light)
    differs = swept != exact
    rim = binary_dilation(exact) & ~binary_erosion(exact)
    assert differs.mean() < 0.01
    assert (differs & ~rim).mean() < 0.001


@pytest.mark.parametrize("tilt_deg", [0.0, 90.0, 180.0, 270.0])
@pytest.mark.parametrize("slant_deg", [30.0, 45.0, 70.0])
def test_wall_casts_its_height_times_tan_slant(tilt_deg: float, slant_deg: float) -> None:
    """The shadow of a wall 6.1 px high lies on the side away from the light."""
    height = np.zeros((101, 101), np.float32)
    if tilt_deg in (0.0, 180.0):
        height[:, 50] = 6.1
    else:
        height[50, :] = 6.1
    shadow = cast_shadow(height, light_vectors(tilt_deg, slant_deg))
    line = shadow[30, :] if tilt_deg in (0.0, 180.0) else shadow[:, 30]
    length = int(6.1 * np.tan(np.radians(slant_deg)))
    towards_lower_index = tilt_deg in (0.0, 270.0)  # light from the right or from below
    expected = np.zeros(101, bool)
    if towards_lower_index:
        expected[50 - length : 50] = True
    else:
        expected[51 : 51 + length] = True
    np.testing.assert_array_equal(line, expected)


@settings(deadline=None, max_examples=40)
@given(
    st.integers(0, 2**32 - 1), st.floats(0, 360), st.floats(5, 80),
    st.integers(2, 40), st.integers(2, 40),
)  # fmt: skip
def test_rotating_grid_and_light_rotates_the_shadow(
    seed: int, tilt_deg: float, slant_deg: float, rows: int, cols: int
) -> None:
    height = np.random.default_rng(seed).uniform(0, 3, (rows, cols)).astype(np.float32)
    x, y, z = light_vectors(tilt_deg, slant_deg)
    np.testing.assert_array_equal(
        cast_shadow(np.rot90(height), [-y, x, z]), np.rot90(cast_shadow(height, [x, y, z]))
    )


@settings(deadline=None, max_examples=40)
@given(st.floats(0, 360), st.floats(1, 80), st.floats(0, 0.95), st.floats(0, 360))
def test_a_lit_plane_has_no_cast_shadow(
    tilt_deg: float, slant_deg: float, share: float, facing_deg: float
) -> None:
    """A plane as steep as `share` of the light's elevation, facing any way."""
    slope = share / np.tan(np.radians(slant_deg))
    rows, cols = np.mgrid[:40, :50]
    facing = np.radians(facing_deg)
    height = 100.0 + min(slope, 5.0) * (np.cos(facing) * cols - np.sin(facing) * rows)
    assert not cast_shadow(height.astype(np.float32), light_vectors(tilt_deg, slant_deg)).any()


def test_overhead_light_and_flat_surfaces_cast_no_shadow() -> None:
    rough = np.random.default_rng(0).uniform(0, 9, (20, 30)).astype(np.float32)
    assert not cast_shadow(rough, [0.0, 0.0, 1.0]).any()
    assert not cast_shadow(np.full((20, 30), 1e4, np.float32), light_vectors(33.0, 89.0)).any()


def test_unusable_input_is_named() -> None:
    flat = np.zeros((4, 4), np.float32)
    for light in ([1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [np.nan, 0.0, 1.0]):
        with pytest.raises(InputError, match="above"):
            cast_shadow(flat, light)
    with pytest.raises(InputError, match="rows, columns"):
        cast_shadow(flat[0], [0.0, 0.0, 1.0])
