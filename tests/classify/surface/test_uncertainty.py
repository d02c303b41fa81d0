"""Standard deviations against the errors of simulated surfaces."""

from dataclasses import replace

import numpy as np
import pytest

from classify import Lighting, Method, SurfaceEstimate, photometric_stereo
from classify.surface.uncertainty import _constants
from rig.scene.render import Gloss, SceneImages, render_frame
from rig.scene.synthetic import synthetic_surface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet
from tests.angles import normal_errors_deg
from tests.evidence.uncertainty import held

SIDE = 192


def scene_of(slant_deg: float, gloss: Gloss | None = None) -> tuple[SceneImages, SimulatedSet]:
    ring = Lighting.ring(slant_deg)
    scene = render_frame(synthetic_surface("rock", 0, 2 * SIDE), ring, SIDE, gloss=gloss)
    return scene, SimulatedSet.expose(scene, ring, SensorModel(bit_depth=12), 0)


def solved(taken: SimulatedSet, method: Method | None = None) -> SurfaceEstimate:
    return photometric_stereo(
        taken.images, taken.lighting, method, ambient=taken.ambient, noise=taken.noise,
        full_scale=taken.full_scale, uncertainty=True,
    )  # fmt: skip


@pytest.mark.parametrize("method", ["ps4_robust", "ps4"])
@pytest.mark.parametrize("gloss", [None, Gloss(0.05, 20.0)], ids=["matt", "gloss"])
def test_95_percent_of_the_errors_are_within_their_intervals(
    method: Method, gloss: Gloss | None
) -> None:
    scene, taken = scene_of(60.0, gloss)
    surface = solved(taken, method)
    lit = (~scene.shadowed).sum(axis=0)
    for lights in (4, 3):
        assert 0.92 < held(scene, surface, lit == lights) < 0.97
    if surface.repaired is not None and method == "ps4_robust":
        assert held(scene, surface, surface.repaired, completed=True) > 0.9


def test_under_low_lights_level_pixels_have_the_largest_errors_and_deviations() -> None:
    surface, ring = synthetic_surface("rock", 0, 2 * SIDE), Lighting.ring(12.0)
    steep = replace(surface, height=2 * surface.height, p=2 * surface.p, q=2 * surface.q)
    scene = render_frame(steep, ring, SIDE)
    estimate = solved(SimulatedSet.expose(scene, ring, SensorModel(bit_depth=8), 0))
    errors, slopes = normal_errors_deg(scene, estimate), np.hypot(scene.p, scene.q)
    level, steepest = slopes < np.quantile(slopes, 0.25), slopes > np.quantile(slopes, 0.75)
    assert errors[level].mean() > 1.4 * errors[steepest].mean()
    assert estimate.angle_sd is not None
    for quarter in (level, steepest):
        assert 0.9 < estimate.angle_sd[quarter].mean() / errors[quarter].mean() < 1.25


def test_a_shadow_that_least_squares_uses_is_in_the_deviation() -> None:
    scene, taken = scene_of(60.0)
    surface = solved(taken, "least_squares")
    lit = (~scene.shadowed).sum(axis=0)
    assert 0.92 < held(scene, surface, lit == 4) < 0.97
    assert 0.93 < held(scene, surface, lit == 3) < 0.985


def test_gloss_in_the_three_lights_that_are_left_is_in_the_deviation() -> None:
    ring, surface = Lighting.ring(60.0), synthetic_surface("rock", 0, 2 * SIDE)
    dark = replace(surface, albedo=0.2 * surface.albedo)
    scene = render_frame(dark, ring, SIDE, gloss=Gloss(0.05, 20.0))
    estimate = solved(SimulatedSet.expose(scene, ring, SensorModel(bit_depth=12), 0))
    assert held(scene, estimate, (~scene.shadowed).sum(axis=0) == 3) > 0.9


def test_no_residue_of_rounding_makes_subnormal_products() -> None:
    # Kernels multiply two of these with a variance of about 1e-8.
    lights, corrections, unit_covariances = _constants(Lighting.ring(45.0), np.full(4, 1e-4))
    values = np.concatenate([np.ravel(each) for each in (lights, corrections, unit_covariances)])
    assert np.abs(values[values != 0.0]).min() > 1e-12


def test_deviations_rotate_with_images_and_lights() -> None:
    _, taken = scene_of(60.0)
    surface = solved(taken)
    lights = taken.lighting.directions
    rotated = photometric_stereo(
        np.ascontiguousarray(np.rot90(taken.images, axes=(1, 2))),
        Lighting(np.stack([-lights[:, 1], lights[:, 0], lights[:, 2]], axis=1)),
        ambient=np.ascontiguousarray(np.rot90(taken.ambient)),
        noise=taken.noise, full_scale=taken.full_scale, uncertainty=True,
    )  # fmt: skip
    for before, after in (("p_sd", "q_sd"), ("q_sd", "p_sd"), ("angle_sd", "angle_sd")):
        expected = np.rot90(getattr(surface, before))
        np.testing.assert_allclose(getattr(rotated, after), expected, rtol=2e-2, atol=1e-4)


def test_they_are_there_only_when_asked_for() -> None:
    _, taken = scene_of(45.0)
    assert taken.solve().angle_sd is None
    surface = solved(taken)
    assert surface.noise_given
    assert surface.cropped(slice(0, 8), slice(0, 9)).angle_sd.shape == (8, 9)
    estimated = solved(replace(taken, noise=None))
    assert not estimated.noise_given
    ratio = estimated.angle_sd / surface.angle_sd
    assert 0.8 < np.median(ratio) < 1.3


def test_noise_that_was_given_too_low_is_found_in_the_residuals() -> None:
    _, taken = scene_of(45.0)
    assert taken.noise is not None
    noise = replace(taken.noise, gain_e_per_dn=4 * taken.noise.gain_e_per_dn)
    ratios = solved(replace(taken, noise=noise)).p_sd / solved(taken).p_sd
    assert 0.9 < np.median(ratios) < 1.1


@pytest.mark.parametrize("lights", [3, 6])
def test_any_number_of_lights_has_deviations(lights: int) -> None:
    lighting = Lighting.from_angles([360.0 / lights * k for k in range(lights)], 45.0)
    scene = render_frame(synthetic_surface("rock", 0, 2 * SIDE), lighting, SIDE)
    surface = solved(SimulatedSet.expose(scene, lighting, SensorModel(bit_depth=12), 0))
    assert 0.92 < held(scene, surface, ~scene.shadowed.any(axis=0)) < 0.97


@pytest.mark.parametrize("lights", [5, 6, 7, 9])
def test_gloss_under_more_than_four_lights_is_in_the_deviation(lights: int) -> None:
    lighting = Lighting.from_angles([360.0 / lights * k for k in range(lights)], 45.0)
    rock, gloss = synthetic_surface("rock", 0, 2 * SIDE), Gloss(0.05, 20.0)
    scene = render_frame(rock, lighting, SIDE, gloss=gloss)
    surface = solved(SimulatedSet.expose(scene, lighting, SensorModel(bit_depth=12), 0))
    assert held(scene, surface, ~scene.shadowed.any(axis=0)) > 0.95
