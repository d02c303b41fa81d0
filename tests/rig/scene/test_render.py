"""Rendered scenes against the formulas, and against the shadow counts of the thesis for sand."""

import numpy as np
import pytest

from classify.errors import InputError
from classify.lighting import Lighting
from rig.scene.render import render_frame, render_scene
from rig.scene.surfaces import PeriodicSurface, SurfacePatch
from rig.scene.synthetic import ALBEDO, synthetic_surface


def plane(p: float, q: float, side: int = 40) -> SurfacePatch:
    rows, cols = np.mgrid[:side, :side].astype(np.float32)
    ones = np.ones((side, side), np.float32)
    return SurfacePatch(p * cols - q * rows, p * ones, q * ones, 0.6 * ones)


@pytest.mark.parametrize(("p", "q"), [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.4)])
def test_a_plane_follows_lamberts_law(p: float, q: float) -> None:
    lighting = Lighting(Lighting.ring(slant_deg=35.0).directions, np.array([1.0, 0.9, 1.2, 0.5]))
    scene = render_scene(plane(p, q), lighting, ambient=0.05)
    tilt, slant = np.radians(lighting.tilts_deg), np.radians(35.0)
    shade = -p * np.cos(tilt) * np.sin(slant) - q * np.sin(tilt) * np.sin(slant) + np.cos(slant)
    expected = 0.6 * shade / np.sqrt(1 + p * p + q * q) * lighting.intensities
    wide = np.broadcast_to(expected[:, None, None], scene.lights.shape)
    np.testing.assert_allclose(scene.lights, wide, rtol=1e-5)
    np.testing.assert_allclose(scene.ambient, 0.03, rtol=1e-6)
    assert not scene.shadowed.any()
    assert scene.lights.dtype == scene.ambient.dtype == np.float32


def test_a_plane_facing_away_from_a_light_is_dark() -> None:
    scene = render_scene(plane(1.5, 0.0), Lighting.ring(slant_deg=45.0))
    assert scene.shadowed[0].all()
    assert (scene.lights[0] == 0.0).all()
    assert not scene.shadowed[2].any()


def test_both_pairs_of_opposite_lights_have_the_same_sum_without_shadow() -> None:
    """i0 + i180 = i90 + i270 = 2 albedo n_z cos(slant): p and q cancel."""
    surface = synthetic_surface("malv", seed=0, tile_px=256)
    lighting = Lighting.ring(slant_deg=20.0)
    scene = render_frame(surface, lighting, 128, rotate_deg=25.0)
    assert scene.shadowed.mean() < 1e-3
    lit = ~scene.shadowed.any(axis=0)
    i0, i90, i180, i270 = scene.lights
    np.testing.assert_allclose((i0 + i180)[lit], (i90 + i270)[lit], atol=1e-5)
    w = np.sqrt(1 + scene.p**2 + scene.q**2)
    expected = 2 * ALBEDO * np.cos(np.radians(20.0)) / w
    np.testing.assert_allclose((i0 + i180)[lit], expected[lit], atol=1e-5)
    np.testing.assert_allclose(scene.albedo, ALBEDO, atol=1e-5)


def test_a_surface_rotated_by_90_under_light_90_gives_the_rotated_image_under_light_0() -> None:
    surface = synthetic_surface("sand", seed=4, tile_px=256)
    lighting = Lighting.ring(slant_deg=60.0)
    still = render_frame(surface, lighting, 100)
    rotated = render_frame(surface, lighting, 100, rotate_deg=90.0)
    for light in range(4):
        expected = np.rot90(still.lights[light])
        agree = np.isclose(rotated.lights[(light + 1) % 4], expected, atol=1e-4)
        assert agree.mean() > 0.999  # except pixels at the rim of a shadow, where rounding decides


def test_relief_outside_the_frame_casts_shadow_into_it() -> None:
    height = np.zeros((128, 128), np.float32)
    height[:, 90:94] = 12.0
    flat = np.zeros_like(height)
    wall = PeriodicSurface(height, flat, flat, flat + 0.5, "wall")
    scene = render_frame(wall, Lighting.from_angles([0.0], 60.0), 40)  # columns 44 to 83
    # 12 tan 60 = 20.8 px from column 90: columns 70 on, which is 26 on in the frame
    assert scene.shadowed[0, :, 27:].all()
    assert not scene.shadowed[0, :, :24].any()


@pytest.fixture(scope="module")
def patches_of_sand() -> list[PeriodicSurface]:
    return [synthetic_surface("sand", seed, 512) for seed in range(3)]


@pytest.mark.parametrize(("slant_deg", "percent"), [(40, 1), (50, 7), (60, 19), (70, 37), (80, 61)])
def test_sand_has_the_shadow_counts_of_the_thesis(
    patches_of_sand: list[PeriodicSurface], slant_deg: float, percent: float
) -> None:
    lighting = Lighting.from_angles([0.0], slant_deg)
    counts = [render_frame(sand, lighting, 512).shadowed.mean() for sand in patches_of_sand]
    assert 100 * np.mean(counts) == pytest.approx(percent, abs=2.0)


def test_cropping_keeps_the_middle() -> None:
    scene = render_frame(synthetic_surface("rock", 0, 64), Lighting.ring(), 40)
    part = scene.cropped(height_px=20, width_px=30)
    np.testing.assert_array_equal(part.lights, scene.lights[:, 10:30, 5:35])
    np.testing.assert_array_equal(part.albedo, scene.albedo[10:30, 5:35])
    with pytest.raises(InputError, match="cannot be cut"):
        scene.cropped(41, 10)


def test_bad_arguments_are_named() -> None:
    with pytest.raises(InputError, match="margin"):
        render_scene(plane(0, 0), Lighting.ring(), margin_px=20)
    with pytest.raises(InputError, match="ambient"):
        render_scene(plane(0, 0), Lighting.ring(), ambient=-0.1)
