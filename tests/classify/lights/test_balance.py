"""Strengths of four lights from four images of a surface."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import Lighting, SensorNoise, photometric_stereo
from classify.lights.algebra import drop_one_constants
from classify.lights.balance import light_balance

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


def photographs(
    strengths: tuple[float, ...], steepness: float = 0.3, lighting: Lighting = RING
) -> np.ndarray:
    lit = np.maximum(np.tensordot(lighting.directions, relief(steepness), 1), 0.0)
    rng = np.random.default_rng(0)
    albedo = rng.uniform(0.3, 1.0, (SIDE, SIDE))
    values = 4000.0 * np.array(strengths)[:, None, None] * albedo * lit
    return (values + rng.normal(0.0, 1.0, values.shape)).astype(np.float32)


def found(images: np.ndarray, lighting: Lighting = RING, saturation: float = np.inf) -> np.ndarray:
    null = drop_one_constants(lighting, "ps4_robust")[1]
    return light_balance(images, None, KNOWN, saturation, QUIET, null)


@settings(deadline=None, max_examples=25)
@given(st.tuples(*[st.floats(0.94, 1.06)] * 4), st.sampled_from([30.0, 45.0, 65.0]))
def test_strengths_are_found_to_some_parts_in_a_thousand(
    strengths: tuple[float, ...], slant_deg: float
) -> None:
    lighting = Lighting.ring(slant_deg)
    factors = found(photographs(strengths, lighting=lighting), lighting)
    even = factors * np.array(strengths)
    assert factors.dtype == np.float32
    assert factors.mean() == pytest.approx(1.0, abs=1e-6)
    if (factors == 1.0).all():
        # Lights that differ like this look like equal ones on a tilted surface.
        first, second, third, fourth = strengths
        assert abs(first - second + third - fourth) < 0.02
    else:
        assert np.ptp(even) / even.mean() < 0.006


def test_equal_lights_are_left_exactly_as_they_are() -> None:
    np.testing.assert_array_equal(found(photographs((1.0,) * 4)), 1.0)


def test_of_a_level_surface_only_the_contradiction_is_known() -> None:
    """Which light is weak cannot be told; no light is changed by more than there is need for."""
    factors = found(photographs((0.95, 1.0, 1.0, 1.0), steepness=0.0))
    values = factors * (0.95, 1.0, 1.0, 1.0)
    assert abs(values[0] - values[1] + values[2] - values[3]) < 0.005
    assert np.abs(factors - 1.0).max() < 0.02


def test_shadow_gloss_and_saturation_do_not_count() -> None:
    images = photographs((0.95, 1.0, 1.03, 1.0))
    alone = found(images)
    images[0, :30] *= 0.05
    images[1, 40:45] *= 3.0
    images[3, 60:90] = 5000.0
    disturbed = found(images, saturation=5000.0)
    assert np.abs(disturbed - alone).max() < 0.003


@pytest.mark.parametrize("strengths", [(0.6, 1.0, 1.0, 1.0), (0.0, 1.0, 1.0, 1.0)])
def test_a_light_that_fails_is_no_matter_of_balance(strengths: tuple[float, ...]) -> None:
    np.testing.assert_array_equal(found(photographs(strengths)), 1.0)


def test_few_pixels_say_nothing() -> None:
    np.testing.assert_array_equal(found(photographs((0.9, 1.0, 1.0, 1.0))[:, :20, :20]), 1.0)


def test_a_weak_light_changes_no_slope() -> None:
    """And the estimate says how strong the lights were."""
    noise = SensorNoise(gain_e_per_dn=1e9, read_noise_dn=1.0)
    true, weak = (
        photometric_stereo(photographs((first, 1.0, 1.0, 1.0)), RING, "ps4_robust", noise=noise)
        for first in (1.0, 0.95)
    )
    plain = photometric_stereo(photographs((0.95, 1.0, 1.0, 1.0)), RING, "ps4")
    assert np.abs(plain.p - true.p).mean() > 0.02
    assert np.abs(weak.p - true.p).max() < 0.01
    np.testing.assert_array_equal(true.lighting.intensities, 1.0)
    strengths = weak.lighting.intensities / weak.lighting.intensities[1]
    np.testing.assert_allclose(strengths, [0.95, 1.0, 1.0, 1.0], atol=0.002)
