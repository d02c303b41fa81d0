"""Rendered scenes against the formulas, and against the shadow counts of the thesis for sand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import InputError
from classify.lighting import Lighting
from rig.scene.render import Gloss, Lens, render_frame, render_scene
from rig.scene.surfaces import PeriodicSurface, SurfacePatch
from rig.scene.synthetic import synthetic_surface


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


@settings(deadline=None, max_examples=30)
@given(
    slopes=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    distance_px=st.floats(60.0, 1e4),
    pixel=st.tuples(st.integers(0, 39), st.integers(0, 39)),
)
def test_a_point_light_has_its_own_direction_and_distance_at_every_pixel(
    slopes: tuple[float, float], distance_px: float, pixel: tuple[int, int]
) -> None:
    p, q = slopes
    distances_px = distance_px * np.array([1.0, 1.5, 2.0, np.inf])
    ring = Lighting.ring(slant_deg=35.0)
    scene = render_scene(plane(p, q), ring, led_distance_px=distances_px)
    x, y = pixel[1] - 19.5, 19.5 - pixel[0]
    normal = np.array([-p, -q, 1.0]) / np.sqrt(1 + p * p + q * q)
    for light, direction in enumerate(ring.directions):
        towards, strength = direction, 1.0
        if light < 3:
            ray = distances_px[light] * direction - np.array([x, y, p * x + q * y])
            towards = ray / np.linalg.norm(ray)
            strength = (distances_px[light] / np.linalg.norm(ray)) ** 2
        expected = 0.6 * (normal @ towards) * strength
        if not scene.shadowed[light][pixel]:
            assert scene.lights[light][pixel] == pytest.approx(expected, rel=1e-4)


def test_a_glossy_surface_is_brightest_where_its_normal_is_halfway_to_the_light() -> None:
    lighting, gloss = Lighting.from_angles([0.0], 40.0), Gloss(strength=0.5, exponent=30.0)
    halfway = -float(np.tan(np.radians(20.0)))
    shine = []
    for p in (halfway - 0.1, halfway, halfway + 0.1, 2.0):
        glossy, matt = (render_scene(plane(p, 0.0), lighting, gloss=g) for g in (gloss, None))
        shine.append(float((glossy.lights - matt.lights).mean()))
    assert shine[1] == pytest.approx(0.5, rel=1e-5)
    assert max(shine[0], shine[2]) < 0.5
    assert shine[3] == 0.0  # in attached shadow


@settings(deadline=None, max_examples=10)
@given(st.floats(0.5, 2.0), st.integers(2, 12))
def test_a_lens_out_of_focus_weakens_fine_waves_and_keeps_the_mean(
    blur_px: float, cycles: int
) -> None:
    scene = render_scene(plane(0.0, 0.0, side=128), Lighting.ring(), ambient=0.02)
    wave = np.cos(2 * np.pi * cycles * np.arange(128) / 128).astype(np.float32)
    waves = replace(scene, lights=np.broadcast_to(1.0 + wave, scene.lights.shape))
    blurred = Lens(blur_px).images(waves).lights[:, 20:-20, 20:-20]
    gain = np.exp(-2.0 * (np.pi * blur_px * cycles / 128) ** 2)
    np.testing.assert_allclose(
        blurred, np.broadcast_to(1.0 + gain * wave[20:-20], blurred.shape), atol=0.01
    )


def test_vignetting_darkens_the_corners_and_not_the_centre() -> None:
    scene = render_scene(plane(0.0, 0.0, side=41), Lighting.ring())
    share = Lens(vignetting=0.2).images(scene).lights / scene.lights
    np.testing.assert_allclose(share[:, 0, 0], 0.8, rtol=1e-5)
    np.testing.assert_allclose(share[:, 20, 20], 1.0)


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
    with pytest.raises(InputError, match="above"):
        render_scene(plane(2.0, 0), Lighting.ring(), led_distance_px=20.0)
