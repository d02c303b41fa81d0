"""Uncertainty of roughness and heights against simulated noise of known size."""

from dataclasses import replace

import numpy as np
import pytest

from classify import Lighting, SurfaceEstimate, integrate_gradients, surface_roughness
from classify.calibration.calibration import CalibratedLights
from classify.relief.roughness import common_error, roughness_uncertainty
from rig.scene.render import render_frame
from rig.scene.synthetic import synthetic_surface

SHAPE, DEVIATION = (96, 128), 0.05


@pytest.fixture
def true() -> SurfaceEstimate:
    scene = render_frame(synthetic_surface("rock", 0, 256), Lighting.ring(45.0), 128)
    p, q, albedo = (plane[: SHAPE[0]] / 5.0 for plane in (scene.p, scene.q, scene.albedo))
    everywhere = np.ones(SHAPE, np.bool_)
    return SurfaceEstimate(p, q, albedo, everywhere, "", lighting=Lighting.ring(45.0))


def noisy(true: SurfaceEstimate, seed: int) -> SurfaceEstimate:
    noise = DEVIATION * np.random.default_rng(seed).standard_normal((2, *SHAPE))
    deviations = np.full(SHAPE, DEVIATION, np.float32)
    return replace(
        true,
        p=(true.p + noise[0]).astype(np.float32),
        q=(true.q + noise[1]).astype(np.float32),
        p_sd=deviations,
        q_sd=deviations,
    )


def test_noise_is_subtracted_from_sdq_and_sq(true: SurfaceEstimate) -> None:
    expected, surface = surface_roughness(true), noisy(true, 0)
    measured = surface_roughness(surface)
    found = roughness_uncertainty(surface, measured)
    assert measured.sdq > 1.1 * expected.sdq
    assert found.corrected.sdq == pytest.approx(expected.sdq, rel=0.01)
    assert abs(found.corrected.sq_px - expected.sq_px) < 0.02 * expected.sq_px
    for name in ("sdq", "sdr_percent", "sa_px", "sq_px"):
        off = abs(getattr(found.corrected, name) - getattr(expected, name))
        assert off < getattr(found.expanded, name)


def test_heights_have_the_noise_that_is_stated(true: SurfaceEstimate) -> None:
    differences, squares = [], []
    for seed in range(40):
        surface = noisy(true, seed)
        noise = integrate_gradients(surface.p - true.p, surface.q - true.q)
        middle = SHAPE[1] // 2
        differences.append(noise[:, middle + 10] - noise[:, middle - 10])
        squares.append(noise[:, -1] - noise[:, 0])
    stated = roughness_uncertainty(surface, surface_roughness(surface), (20.0, 127.0)).height_sd_px
    assert stated[20.0] == pytest.approx(np.std(differences), rel=0.1)
    assert stated[127.0] == pytest.approx(np.std(squares), rel=0.1)


def lights_with(
    directions_deg: float = 0.0, residual: float = 0.0, distances: float | None = None
) -> CalibratedLights:
    lighting = Lighting.ring(45.0)
    errors = None
    if distances is not None:
        lighting, errors = Lighting.near(256.0 * lighting.directions), np.full(4, distances)
    return CalibratedLights(lighting, "plate", np.full(4, directions_deg), errors, residual, None)


def test_errors_of_the_lights_are_those_of_a_wrong_solution(true: SurfaceEstimate) -> None:
    assert common_error(true, lights_with()).slope_rms == 0.0
    level = replace(true, p=0 * true.p, q=0 * true.q)
    # Opposite lights that differ by 1 % tilt a level part by 0.01 tan(slant) / 2; there are four.
    assert common_error(level, lights_with(residual=0.01)).mean_slope == pytest.approx(0.01, 0.05)
    assert common_error(true, lights_with(0.3)).sdq < 0.01


def test_errors_of_distances_and_of_the_response_are_propagated(true: SurfaceEstimate) -> None:
    lights = lights_with(distances=0.01)
    near = replace(true, lighting=lights.lighting)
    # With all distances 1 % off the image of a light is off by 0.01 b . X / R.
    inner = true.p * (np.arange(128) - 63.5) - true.q * (np.arange(96) - 47.5)[:, None]
    found = common_error(near, lights)
    rms = np.sqrt(np.mean(np.square(0.01 * inner / 256.0)))
    assert found.slope_rms == pytest.approx(np.sqrt(2.0) * rms, rel=0.3)
    # Of four lights at 45 degrees an error u of each gives slopes of u / b_z in p and in q.
    level = replace(true, p=0 * true.p, q=0 * true.q)
    found = common_error(level, lights_with(), response_error=0.004)
    assert found.slope_rms == pytest.approx(np.sqrt(2.0) * 0.004 / 0.16, rel=0.05)
