"""LED levels from the redundancy of four images of a surface."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import Lighting, SensorNoise, photometric_stereo
from classify.images import ImageStack
from classify.lights.led_levels import LEVEL_SAMPLES, LitSamples, level_corrections

SIDE = 128
RING = Lighting.ring(45.0)
KNOWN = np.full(4, 1.0, np.float32)
QUIET = np.array([1.0, 0.0, 0.0], np.float32)  # 1 DN, at values of some thousands


def relief(steepness: float) -> np.ndarray:
    """(3, SIDE, SIDE) normals of z = sin(x / 8) sin(y / 6)."""
    column, row = np.meshgrid(np.arange(SIDE), -np.arange(SIDE))
    x, y = column / 8.0, row / 6.0
    p = steepness * np.cos(x) * np.sin(y)
    q = steepness * 8.0 / 6.0 * np.sin(x) * np.cos(y)
    return np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1.0 + p * p + q * q)


def images_with(
    levels: tuple[float, ...], steepness: float = 0.3, lighting: Lighting = RING
) -> np.ndarray:
    lit = np.maximum(np.tensordot(lighting.directions, relief(steepness), 1), 0.0)
    rng = np.random.default_rng(0)
    albedo = rng.uniform(0.3, 1.0, (SIDE, SIDE))
    values = 4000.0 * np.array(levels)[:, None, None] * albedo * lit
    return (values + rng.normal(0.0, 1.0, values.shape)).astype(np.float32)


def found(images: np.ndarray, lighting: Lighting = RING, saturation: float = np.inf) -> np.ndarray:
    samples = ImageStack(images, None).sample(LEVEL_SAMPLES, KNOWN)
    lit = LitSamples.of(*samples, saturation)
    return level_corrections(lit, KNOWN, QUIET, lighting)


@settings(deadline=None, max_examples=25)
@given(st.tuples(*[st.floats(0.94, 1.06)] * 4), st.sampled_from([30.0, 45.0, 65.0]))
def test_levels_are_found_to_a_few_parts_in_a_thousand(
    levels: tuple[float, ...], slant_deg: float
) -> None:
    lighting = Lighting.ring(slant_deg)
    factors = found(images_with(levels, lighting=lighting), lighting)
    even = factors * np.array(levels)
    assert factors.dtype == np.float32
    assert factors.mean() == pytest.approx(1.0, abs=1e-6)
    if (factors == 1.0).all():
        # On a tilted surface these levels give the same images as equal ones.
        first, second, third, fourth = levels
        assert abs(first - second + third - fourth) < 0.02
    else:
        assert np.ptp(even) / even.mean() < 0.006


def test_equal_lights_get_no_correction() -> None:
    np.testing.assert_array_equal(found(images_with((1.0,) * 4)), 1.0)


def test_a_level_surface_gets_the_smallest_correction() -> None:
    """Its images do not determine which light is weak."""
    factors = found(images_with((0.95, 1.0, 1.0, 1.0), steepness=0.0))
    values = factors * (0.95, 1.0, 1.0, 1.0)
    assert abs(values[0] - values[1] + values[2] - values[3]) < 0.005
    assert np.abs(factors - 1.0).max() < 0.02


def test_shadow_gloss_and_saturation_are_left_out() -> None:
    images = images_with((0.95, 1.0, 1.03, 1.0))
    alone = found(images)
    images[0, :30] *= 0.05
    images[1, 40:45] *= 3.0
    images[3, 60:90] = 5000.0
    disturbed = found(images, saturation=5000.0)
    assert np.abs(disturbed - alone).max() < 0.003


def test_a_failed_light_gets_no_correction() -> None:
    np.testing.assert_array_equal(found(images_with((0.0, 1.0, 1.0, 1.0))), 1.0)


@pytest.mark.parametrize("slant_deg", [30.0, 45.0, 60.0])
def test_levels_of_glossy_photographs_are_found_from_their_brightness(slant_deg: float) -> None:
    """A lobe of a tenth of the light: levels that make the residual least are wrong."""
    levels = np.array([0.7, 1.2, 0.9, 1.1])
    lighting = Lighting.ring(slant_deg)
    halfway = lighting.directions + np.array([0.0, 0.0, 1.0])
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    lobe = np.maximum(np.tensordot(halfway, relief(0.2), 1), 0.0) ** 30
    images = images_with((1.0,) * 4, 0.2, lighting) + np.float32(400.0) * lobe.astype(np.float32)
    np.testing.assert_allclose(found(images, lighting), 1.0, atol=0.03)
    factors = found(images * levels[:, None, None].astype(np.float32), lighting)
    even = factors * levels
    np.testing.assert_allclose(even / even.mean(), 1.0, atol=0.06)


def test_a_tilted_surface_is_not_taken_for_unequal_lights() -> None:
    """Its images differ in brightness as under unequal lights, without residual."""
    normals = relief(0.1)
    p, q = -normals[0] / normals[2] + 0.3, -normals[1] / normals[2] - 0.2
    tilted = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1.0 + p * p + q * q)
    values = 4000.0 * np.tensordot(RING.directions, tilted, 1)
    noise = np.random.default_rng(1).normal(0.0, 30.0, values.shape)
    np.testing.assert_allclose(found((values + noise).astype(np.float32)), 1.0, atol=0.01)


def test_few_pixels_give_no_correction() -> None:
    np.testing.assert_array_equal(found(images_with((0.9, 1.0, 1.0, 1.0))[:, :20, :20]), 1.0)


def test_a_weak_light_changes_no_slope() -> None:
    """The lighting of the estimate holds the levels found."""
    noise = SensorNoise(gain_e_per_dn=1e9, read_noise_dn=1.0)
    true, weak = (
        photometric_stereo(images_with((first, 1.0, 1.0, 1.0)), RING, "ps4_robust", noise=noise)
        for first in (1.0, 0.95)
    )
    plain = photometric_stereo(images_with((0.95, 1.0, 1.0, 1.0)), RING, "ps4")
    assert np.abs(plain.p - true.p).mean() > 0.02
    assert np.abs(weak.p - true.p).max() < 0.01
    np.testing.assert_array_equal(true.lighting.intensities, 1.0)
    levels = weak.lighting.intensities / weak.lighting.intensities[1]
    np.testing.assert_allclose(levels, [0.95, 1.0, 1.0, 1.0], atol=0.002)
