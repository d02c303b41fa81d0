"""Bounds, means and validity of texture fields."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from classify import InputError, SurfaceEstimate
from classify.texture.fields import texture_fields

STEEPEST = 2.0
SLOPES = arrays(np.float32, (5, 7), elements=st.floats(-1e6, 1e6, width=32))


@settings(max_examples=60, deadline=None)
@given(SLOPES, SLOPES)
def test_bounded_slopes_keep_their_direction(surface_of, p: np.ndarray, q: np.ndarray) -> None:
    fields = texture_fields(surface_of(p, q, np.ones_like(p)))
    steepness = np.hypot(p.astype(float), q)
    found = np.hypot(fields.p.astype(float), fields.q)
    np.testing.assert_allclose(found, np.minimum(steepness, STEEPEST), rtol=1e-5)
    across = fields.p.astype(float) * q - fields.q.astype(float) * p
    np.testing.assert_allclose(across / np.maximum(steepness, 1e-30), 0.0, atol=1e-5)
    along = fields.p.astype(float) * p + fields.q.astype(float) * q
    assert (along >= 0.0).all()


def patchy(surface_of, damage: float) -> SurfaceEstimate:
    """A surface of which a third of the pixels is not valid and contains `damage`."""
    rng = np.random.default_rng(3)
    p, q = rng.normal(0.1, 0.5, (2, 30, 20))
    albedo = rng.uniform(0.2, 0.8, (30, 20))
    surface = surface_of(p, q, albedo)
    surface.valid[:] = rng.random((30, 20)) > 0.33
    for field in (surface.p, surface.q, surface.albedo):
        field[~surface.valid] = damage
    return surface


@pytest.mark.parametrize("damage", [0.0, 300.0, -1e30, np.inf, np.nan])
def test_pixels_that_are_not_valid_have_the_means_of_the_others(surface_of, damage: float) -> None:
    surface = patchy(surface_of, damage)
    fields = texture_fields(surface)
    for field, mean in (
        (fields.p, surface.p[surface.valid].mean()),
        (fields.q, surface.q[surface.valid].mean()),
        (fields.albedo, 1.0),
    ):
        np.testing.assert_allclose(field[~surface.valid], mean, rtol=1e-5)
        assert field.dtype == np.float32
    np.testing.assert_array_equal(fields.p[surface.valid], surface.p[surface.valid])
    assert fields.shape == surface.shape == (30, 20)


def test_the_mean_slope_is_that_of_bounded_slopes(surface_of) -> None:
    p = np.array([[200.0, 0.0, 7.0]])
    surface = surface_of(p, 0 * p, 1 + 0 * p)
    surface.valid[0, 2] = False
    assert texture_fields(surface).p.tolist() == [[2.0, 0.0, 1.0]]


def test_albedo_is_in_units_of_its_mean_and_bounded(surface_of) -> None:
    albedo = np.full((20, 20), 0.3)
    albedo[4, 5] = 90.0
    fields = texture_fields(surface_of(0 * albedo, 0 * albedo, albedo))
    assert fields.albedo.max() == 8.0
    assert fields.albedo[0, 0] == pytest.approx(0.3 / albedo.mean())
    brighter = texture_fields(surface_of(0 * albedo, 0 * albedo, 1000 * albedo))
    np.testing.assert_allclose(brighter.albedo, fields.albedo, rtol=1e-5)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 500)])
def test_any_shape_has_fields(surface_of, shape: tuple[int, int]) -> None:
    ones = np.ones(shape)
    fields = texture_fields(surface_of(0.5 * ones, -0.2 * ones, 0.7 * ones))
    assert fields.shape == shape
    np.testing.assert_allclose(fields.albedo, 1.0, rtol=1e-6)


def test_surfaces_without_a_valid_pixel_or_any_albedo_are_refused(surface_of) -> None:
    ones = np.ones((4, 4))
    with pytest.raises(InputError, match=r"no pixel .* valid"):
        texture_fields(replace(surface_of(ones, ones, ones), valid=np.zeros((4, 4), bool)))
    with pytest.raises(InputError, match="reflect nothing"):
        texture_fields(surface_of(ones, ones, 0 * ones))


@pytest.mark.parametrize("damage", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("field", ["p", "q", "albedo"])
def test_nan_at_a_valid_pixel_is_refused(surface_of, field: str, damage) -> None:
    ones = np.ones((4, 4))
    surface = surface_of(ones, ones, ones)
    getattr(surface, field)[2, 3] = damage
    with pytest.raises(InputError, match="albedo of NaN"):
        texture_fields(surface)
