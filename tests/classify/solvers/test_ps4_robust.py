"""ps4_robust: the noise gate, the light left out, and slopes filled in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import Lighting, SensorNoise, SurfaceEstimate, photometric_stereo
from classify.base.threads import set_thread_count
from classify.images import ImageStack
from classify.solvers.problem import Problem
from classify.solvers.robust import solve_ps4_robust
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import Gloss, render_frame

SIDE = 96
RING = Lighting.ring(60.0)
WHITE = 200.0
QUIET = SensorNoise(gain_e_per_dn=1e9, read_noise_dn=0.3)


def waves(steepness: float = 0.3, side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """P and q of z = sin(x / 8) sin(y / 6): a surface, free of curl."""
    column, row = np.meshgrid(np.arange(side), -np.arange(side))
    x, y = column / 8.0, row / 6.0
    return (steepness * np.cos(x) * np.sin(y), steepness * 8.0 / 6.0 * np.sin(x) * np.cos(y))


def shading(p: np.ndarray, q: np.ndarray, lighting: Lighting = RING) -> np.ndarray:
    normals = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1 + p * p + q * q)
    lit = np.maximum(np.tensordot(lighting.directions, normals, 1), 0.0)
    return lit * lighting.intensities[:, None, None]


def solved(
    values: np.ndarray, noise: SensorNoise | None = QUIET, lighting: Lighting = RING
) -> SurfaceEstimate:
    return photometric_stereo(values.astype(np.float32), lighting, "ps4_robust", noise=noise)


def solved_plainly(values: np.ndarray, lighting: Lighting) -> SurfaceEstimate:
    return photometric_stereo(values.astype(np.float32), lighting, "least_squares")


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(error))))


def test_ps4_robust_is_the_default_for_four_lights_only() -> None:
    images = np.full((4, 8, 8), 90, np.uint8)
    assert photometric_stereo(images, Lighting.ring()).method == "ps4_robust"
    for lights in (3, 5, 6):
        ring = Lighting.ring(45, [360 / lights * light for light in range(lights)])
        surface = photometric_stereo(np.full((lights, 8, 8), 90, np.uint8), ring)
        assert surface.method == "least_squares"


def test_without_shadow_nearly_all_pixels_are_least_squares() -> None:
    sigma = 2.0
    p, q = waves(0.2, 200)
    values = WHITE * shading(p, q) + np.random.default_rng(0).normal(0, sigma, (4, 200, 200))
    robust = solved(values, SensorNoise(1e9, sigma))
    plain = photometric_stereo(values.astype(np.float32), RING, "least_squares")
    assert (robust.dropped == 255).mean() > 0.99
    for found, expected in ((robust.p, plain.p), (robust.albedo, plain.albedo)):
        assert np.isclose(found, expected, rtol=1e-5, atol=1e-5).mean() > 0.99
    np.testing.assert_allclose(robust.residual, plain.residual, atol=1e-3)
    assert rms(robust.p - p) < 1.02 * rms(plain.p - p)
    assert robust.valid.all()


@pytest.mark.parametrize("lights", [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
def test_pixels_with_two_dark_lights_are_completed_from_neighbours(lights: tuple[int, int]) -> None:
    p, q = waves()
    values = WHITE * shading(p, q)
    hole = np.zeros((SIDE, SIDE), bool)
    hole[30:60:7, 20:70] = True  # one pixel wide
    hole[65:69, 20:70] = True  # four
    for light in lights:
        values[light][hole] = 0.0
    surface = solved(values)
    plain = photometric_stereo(values.astype(np.float32), RING, "ps4")
    np.testing.assert_array_equal(surface.repaired, hole)
    assert surface.valid.all()
    assert not plain.valid[hole].any()
    for found, dropped, true in ((surface.p, plain.p, p), (surface.q, plain.q, q)):
        assert rms((found - true)[hole]) < 0.03
        assert rms((found - true)[hole]) < 0.2 * max(rms((dropped - true)[hole]), 0.15)
    assert rms(surface.albedo[hole] / WHITE - 1.0) < 0.03
    assert (surface.shadow_count[hole] == 2).all()
    assert (surface.dropped[hole] == min(lights)).all()
    np.testing.assert_allclose(surface.p[~hole], p[~hole], atol=2e-3)


@pytest.mark.parametrize("lit", [None, 2])
def test_pixels_with_one_light_or_none_are_filled_in_but_not_valid(lit: int | None) -> None:
    p, q = waves()
    values = WHITE * shading(p, q)
    for light in {0, 1, 2, 3} - {lit}:
        values[light, 40:44, 40:44] = 0.0
    surface = solved(values)
    hole = np.zeros((SIDE, SIDE), bool)
    hole[40:44, 40:44] = True
    np.testing.assert_array_equal(surface.repaired, hole)
    np.testing.assert_array_equal(surface.valid, ~hole)
    assert rms((surface.p - p)[hole]) < 0.06
    assert rms((surface.q - q)[hole]) < 0.06
    np.testing.assert_allclose(surface.albedo[hole], WHITE, rtol=0.02)
    assert (surface.shadow_count[hole] == (4 if lit is None else 3)).all()


def test_the_inside_of_a_large_black_area_is_not_filled_in() -> None:
    values = WHITE * shading(*waves())
    values[:, 20:80, 20:80] = 0.0
    surface = solved(values)
    inside = np.s_[30:70, 30:70]
    assert not surface.valid[20:80, 20:80].any()
    assert not surface.repaired[inside].any()
    assert (surface.p[inside] == 0).all()
    assert (surface.q[inside] == 0).all()
    assert surface.repaired[21, 50]


def test_the_result_does_not_depend_on_threads_or_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    values = WHITE * shading(*waves(0.6)) + rng.normal(0, 2.0, (4, SIDE, SIDE))
    values[rng.random(values.shape) < 0.2] = 0.0
    stack = ImageStack(values.astype(np.float32), None)
    problem = Problem(stack, RING, None, SensorNoise(1e9, 2.0), np.float32(np.inf))
    whole = solve_ps4_robust(problem)
    set_thread_count(3)
    monkeypatch.setattr("classify.solvers.strips.STRIP_PX", 2 * SIDE)
    monkeypatch.setattr("classify.solvers.unsolved.PART_PIXELS", 8)
    strips = solve_ps4_robust(problem)
    assert whole.repaired.mean() > 0.1
    for name in ("p", "q", "albedo", "left_out", "valid", "repaired"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(strips, name))


def test_a_wrong_led_level_is_not_mistaken_for_shadow() -> None:
    """5 % too weak at low noise: every pixel has a small residual."""
    p, q = waves(0.2)
    values = 3000.0 * shading(p, q, Lighting.ring())
    values[1] *= 0.95
    noise = SensorNoise(gain_e_per_dn=1e9, read_noise_dn=1.0)
    surface = solved(values, noise, lighting=Lighting.ring())
    assert (surface.dropped == 255).all()
    assert not surface.specular.any()
    # The error is the same everywhere: a tilt, not a pattern.
    assert (surface.q - q).std() < 0.005


def test_intensities_that_were_given_are_believed() -> None:
    """Lights a few degrees off leave a residual like that of unequal levels."""
    lighting = Lighting.ring(45.0)
    p, q = waves(0.3, 128)
    moved = Lighting(lighting.directions + np.random.default_rng(5).normal(0.0, 0.05, (4, 3)))
    values = 3000.0 * shading(p, q, moved)
    believed = solved(values, lighting=Lighting(lighting.directions, np.ones(4)))
    estimated = solved(values, lighting=lighting)
    assert believed.led_levels is None
    np.testing.assert_array_equal(believed.lighting.intensities, 1.0)
    np.testing.assert_array_equal(estimated.led_levels, estimated.lighting.intensities)
    assert np.abs(estimated.led_levels - 1.0).max() > 0.02
    plain = photometric_stereo(values.astype(np.float32), lighting, "least_squares")
    assert rms(believed.p - p) < 1.02 * rms(plain.p - p)


@settings(deadline=None, max_examples=10)
@given(
    seed=st.integers(0, 2**32 - 1), slant_deg=st.floats(20.0, 65.0), tilt_deg=st.floats(0.0, 90.0)
)
def test_slopes_are_continuous_in_the_images(seed: int, slant_deg: float, tilt_deg: float) -> None:
    """Each row goes from one pixel to another, past changes of the light to blame."""
    lighting = Lighting.ring(slant_deg, [tilt_deg + 90.0 * light for light in range(4)])
    ends = np.random.default_rng(seed).uniform(0.25, 1.0, (2, 4, 40, 1))
    part = np.linspace(0.0, 1.0, 4000)
    surface = solved(3000.0 * ((1.0 - part) * ends[0] + part * ends[1]), lighting=lighting)
    plain = solved_plainly(3000.0 * ((1.0 - part) * ends[0] + part * ends[1]), lighting)
    assert (surface.dropped < 255).any()
    assert surface.valid.all()
    for slope, of_all in ((surface.p, plain.p), (surface.q, plain.q)):
        assert np.abs(np.diff(slope)).max() < 12.0 * np.abs(np.diff(of_all)).max()


@pytest.mark.parametrize("gloss", [Gloss(0.15, 15.0), Gloss(0.3, 30.0)])
@pytest.mark.parametrize("material", ["Bark014", "Tiles036"])
def test_glossy_materials_under_near_lights_show_no_seams(material: str, gloss: Gloss) -> None:
    """No slope changes much more from pixel to pixel than the images do."""
    lighting = Lighting.ring(35.0)
    scene = render_frame(
        load_material(bundled_materials()[material]), lighting, 192, ambient=0.0, gloss=gloss,
        led_distance_px=500.0,
    )  # fmt: skip
    values = 3000.0 * scene.lights + np.random.default_rng(0).normal(0.0, 2.0, scene.lights.shape)
    found = largest_step(values, solved(values, SensorNoise(1e9, 2.0), lighting))
    assert found < 2.5 * largest_step(values, solved_plainly(values, lighting))


def largest_step(values: np.ndarray, surface: SurfaceEstimate) -> float:
    """Largest step of a slope between lit neighbours, per relative step of the images."""
    lit = values.min(axis=0) > 0.2 * values.max(axis=0)
    largest = 0.0
    for axis in (0, 1):
        change = np.abs(np.diff(values, axis=axis + 1)).max(axis=0)
        brightness, near = values.mean(axis=0), np.diff(lit.astype(int), axis=axis) == 0
        first = np.delete(brightness, -1, axis), np.delete(lit, -1, axis)
        relative = np.maximum(change / first[0], 0.003)
        for slope in (surface.p, surface.q):
            steps = np.abs(np.diff(slope, axis=axis)) / relative
            largest = max(largest, float(steps[near & first[1]].max()))
    return largest


def test_dark_material_is_not_shadow() -> None:
    """At slant 70 a level surface gives a third of its albedo, here four sigma."""
    lighting = Lighting.ring(70.0)
    sigma = 2.0
    p, q = waves(0.0, 128)
    values = 24.0 * shading(p, q, lighting)
    values += np.random.default_rng(2).normal(0, sigma, values.shape)
    surface = solved(values, SensorNoise(1e9, sigma), lighting=lighting)
    assert surface.repaired.mean() < 0.05
    assert surface.valid.mean() > 0.95
    assert rms(surface.p) < 0.12


def test_the_noise_of_the_sensor_decides_which_residual_counts() -> None:
    """80 instead of 100 is a residual of five sigma at noise 2, but not at 8."""
    images = np.full((4, 32, 32), 100.0, np.float32)
    images[2, :8] = 80.0
    for read_noise, dropped in ((2.0, True), (8.0, False)):
        surface = solved(images, SensorNoise(1e9, read_noise), lighting=Lighting.ring())
        assert ((surface.dropped[:8] == 2) == dropped).all()
    # Shot noise: 100 electrons have a deviation of 10.
    surface = solved(images, SensorNoise(1.0, 0.0), lighting=Lighting.ring())
    assert (surface.dropped == 255).all()
    assert (solved(images, SensorNoise(1.0, 0.0, black_level_dn=99.0), lighting=Lighting.ring())
            .dropped[:8] == 2).all()  # fmt: skip


def test_noise_is_estimated_where_the_sensor_is_unknown() -> None:
    """From the images alone, even if most pixels are in shadow under some light."""
    sigma = 2.0
    rng = np.random.default_rng(3)
    values = WHITE * shading(*waves(0.2, 160)) + rng.normal(0, sigma, (4, 160, 160))
    for light in range(3):
        values[light, 40 * light : 40 * light + 40] = rng.normal(0, sigma, (40, 160))
    known = solved(values, SensorNoise(1e9, sigma))
    unknown = solved(values, None)
    assert (known.dropped != unknown.dropped).mean() < 0.01
    shadowed = np.arange(160) < 120
    assert (unknown.dropped[shadowed] < 3).mean() > 0.99


def test_ambient_light_raises_the_limit_of_dark_pixels() -> None:
    """A pixel without light is the difference of two values with ambient noise."""
    values = np.full((4, 32, 32), 1000.0)
    ambient = np.full((32, 32), 400.0, np.float32)
    values[2:, 10] = 400.0 + 50.0
    images = values.astype(np.float32)
    # 20 DN of shot noise at the ambient level, 28 in the difference: 50 is dark, at 4 DN it is not.
    for gain, repaired in ((1.0, True), (25.0, False)):
        surface = photometric_stereo(
            images, Lighting.ring(), "ps4_robust", ambient=ambient, noise=SensorNoise(gain, 0.0)
        )
        assert (surface.repaired[10] == repaired).all()


@pytest.mark.parametrize("saturated", [1, 2, 3, 4])
def test_saturated_lights_are_left_out(saturated: int) -> None:
    p, q = waves(0.2)
    values = np.round(3000.0 * shading(p, q))
    spot = np.zeros((SIDE, SIDE), bool)
    spot[40:43, 50:53] = True
    values[:saturated, spot] = 4095.0
    surface = photometric_stereo(values.astype(np.uint16), RING, full_scale=4095, noise=QUIET)
    np.testing.assert_array_equal(surface.saturated, spot)
    np.testing.assert_array_equal(surface.valid, ~spot | (saturated == 1))
    np.testing.assert_array_equal(surface.repaired, spot & (saturated > 1))
    np.testing.assert_array_equal(surface.specular, spot & (saturated == 1))
    assert rms((surface.p - p)[spot]) < (0.005 if saturated == 1 else 0.05)


def test_a_crop_of_the_images_gives_the_crop_of_the_maps() -> None:
    """Except at its edge, where pixels are filled in from their surroundings."""
    p, q = waves(0.5, 160)
    values = WHITE * shading(p, q)
    values[:2, 60:64, 40:120] = 0.0
    whole = solved(values)
    part = solved(values[:, 30:100, 30:130])
    np.testing.assert_allclose(part.p[5:-5, 5:-5], whole.p[35:95, 35:125], atol=5e-3)
    np.testing.assert_array_equal(part.repaired, whole.repaired[30:100, 30:130])
