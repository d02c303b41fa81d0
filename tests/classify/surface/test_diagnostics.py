"""Residual, shadows and highlights against plain numpy."""

import numpy as np
import pytest

from classify import METHODS, InputError, Lighting, Method, SurfaceEstimate, photometric_stereo

SHAPE = (37, 43)
FULL_SCALE = 4095.0


def lighting_for(method: Method) -> Lighting:
    tilts = np.arange(6) * 60.0 if method == "rushmeier" else np.arange(4) * 90.0
    slants = 45.0 + np.arange(len(tilts))
    return Lighting(
        Lighting.from_angles(list(tilts), list(slants)).directions,
        np.linspace(0.8, 1.2, len(tilts)),
    )


@pytest.fixture(params=METHODS)
def surface(request: pytest.FixtureRequest) -> SurfaceEstimate:
    """A rough, spotted surface with cast shadows, highlights and saturated pixels."""
    rng = np.random.default_rng(0)
    lighting = lighting_for(request.param)
    p, q = 0.4 * rng.standard_normal((2, *SHAPE))
    normals = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1 + p * p + q * q)
    lit = np.maximum(np.tensordot(lighting.directions, normals, 1), 0.0)
    values = 2500.0 * rng.uniform(0.3, 1.0, SHAPE) * lit * lighting.intensities[:, None, None]
    values[rng.random(values.shape) < 0.1] = 0.0
    values[rng.random(values.shape) < 0.02] *= 3.0
    ambient = rng.uniform(100, 200, SHAPE)
    images = np.minimum(np.round(values + ambient), FULL_SCALE).astype(np.uint16)
    return photometric_stereo(
        images, lighting, request.param, ambient=ambient.astype(np.uint16), full_scale=FULL_SCALE
    )


def light_values(surface: SurfaceEstimate) -> np.ndarray:
    less_ambient = surface.images.astype(float) - surface.ambient
    return less_ambient / (FULL_SCALE * surface.lighting.intensities[:, None, None])


def test_the_residual_is_that_of_least_squares_of_all_lights(surface: SurfaceEstimate) -> None:
    L = surface.lighting.directions
    values = light_values(surface).reshape(len(L), -1)
    left_over = values - L @ np.linalg.lstsq(L, values)[0]
    expected = np.sqrt(np.square(left_over).mean(axis=0)).reshape(SHAPE)
    np.testing.assert_allclose(surface.residual, expected, atol=2e-6)


def test_three_lights_leave_no_residual_to_judge_by(surface: SurfaceEstimate) -> None:
    assert surface.residual_share is not None
    three = Lighting.ring(45.0, (0.0, 120.0, 240.0))
    solved = photometric_stereo(surface.images[:3], three, "least_squares")
    assert solved.valid.any()
    assert solved.residual_share is None


def test_shadows_and_highlights_are_relative_to_the_prediction(surface: SurfaceEstimate) -> None:
    L = surface.lighting.directions
    normals = np.moveaxis(surface.normals.astype(float), -1, 0)
    predicted = surface.albedo * np.tensordot(L, normals, 1)
    values = light_values(surface)

    def beyond(fraction: float, floor: float) -> np.ndarray:
        least = np.maximum(floor * surface.albedo.astype(float), 1e-9)
        return values / np.maximum(predicted, least) - fraction

    below, above = beyond(0.5, 0.1), beyond(1.5, 0.2)
    clear = (np.abs(below) > 1e-4).all(axis=0) & (np.abs(above) > 1e-4).all(axis=0)
    clear &= (surface.albedo > 1e-3) & ((surface.p != 0.0) | (surface.q != 0.0) | surface.valid)
    assert clear.mean() > 0.8
    np.testing.assert_array_equal(surface.shadow_count[clear], (below <= 0).sum(axis=0)[clear])
    np.testing.assert_array_equal(surface.shadow_mask, surface.shadow_count > 0)
    bright = (above >= 0).any(axis=0)
    if surface.highlights is not None:
        bright &= surface.highlights
    np.testing.assert_array_equal(surface.specular[clear], bright[clear])
    assert surface.specular.mean() < 0.5
    assert surface.specular.mean() > 0.005 or surface.method == "ps4"


def test_pixels_at_full_scale_are_saturated(surface: SurfaceEstimate) -> None:
    expected = (surface.images >= FULL_SCALE).any(axis=0)
    assert expected.any()
    np.testing.assert_array_equal(surface.saturated, expected)


@pytest.mark.parametrize("name", ["dropped", "residual", "shadow_count", "saturated", "specular"])
def test_an_estimate_without_images_refuses_derived_maps(surface_of, name: str) -> None:
    ones = np.ones((4, 4))
    with pytest.raises(InputError, match="no images"):
        getattr(surface_of(ones, ones, ones), name)
