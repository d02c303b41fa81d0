"""Relighting, the inverse of `photometric_stereo`."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import Lighting, SurfaceEstimate, photometric_stereo, relight

SurfaceOf = Callable[..., SurfaceEstimate]


def test_a_relit_surface_is_recovered_by_solving(surface_of: SurfaceOf) -> None:
    rng = np.random.default_rng(0)
    p, q = rng.uniform(-0.4, 0.4, (2, 40, 30))
    surface = surface_of(p, q, rng.uniform(0.2, 0.9, (40, 30)))
    lighting = Lighting(Lighting.ring(45.0).directions, np.array([1.0, 0.5, 2.0, 1.5]))
    images = relight(surface, lighting)
    assert images.shape == (4, 40, 30)
    assert images.dtype == np.float32
    again = photometric_stereo(images, lighting)
    np.testing.assert_allclose(again.p, surface.p, atol=2e-5)
    np.testing.assert_allclose(again.q, surface.q, atol=2e-5)
    np.testing.assert_allclose(again.albedo, surface.albedo, atol=2e-5)


@settings(deadline=None)
@given(st.floats(0, 360), st.floats(0, 85), st.floats(-2, 2), st.floats(-2, 2))
def test_a_facet_follows_lambert(
    surface_of: SurfaceOf, tilt_deg: float, slant_deg: float, p: float, q: float
) -> None:
    one = np.ones((1, 1))
    tilt, slant = np.radians([tilt_deg, slant_deg])
    normal = np.array([-p, -q, 1.0]) / np.sqrt(1 + p * p + q * q)
    light = [np.cos(tilt) * np.sin(slant), np.sin(tilt) * np.sin(slant), np.cos(slant)]
    image = relight(
        surface_of(p * one, q * one, 0.7 * one), Lighting.from_angles([tilt_deg], slant_deg)
    )
    assert image[0, 0, 0] == pytest.approx(0.7 * max(0.0, float(normal @ light)), abs=1e-6)


def test_only_pixels_that_face_away_from_the_light_are_black(surface_of: SurfaceOf) -> None:
    """A steep ridge under grazing light from the right: no shadow to its left."""
    p = np.zeros((9, 31))
    p[:, 10:15], p[:, 16:21] = 2.0, -2.0
    image = relight(surface_of(p, 0 * p, np.ones(p.shape)), Lighting.from_angles([0.0], 70.0))[0]
    assert (image[:, 10:15] == 0).all()
    assert (image[:, 16:21] > 0.9).all()
    np.testing.assert_allclose(image[:, :10], np.cos(np.radians(70.0)), rtol=1e-6)
