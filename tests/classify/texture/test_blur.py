"""Blur of fields and spectra, and the least distance over blurs."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.texture.blur import (
    KNOTS_PX2,
    MAX_BLURRIER_PX,
    MAX_SHARPER_PX,
    blur_gains,
    blur_penalty,
    blurred_fields,
    blurred_surface,
    min_over_blurs,
)
from classify.texture.fields import texture_fields
from classify.texture.spectra import field_spectra

RINGS, NUMBERS = 5, 12


@pytest.mark.parametrize("knot", range(3))
def test_blurred_fields_have_the_spectra_of_the_gains(stationary, knot: int) -> None:
    fields = texture_fields(stationary("rough", seed=1))
    sharp = field_spectra(fields, 64)
    blurred = field_spectra(blurred_fields(fields, KNOTS_PX2[knot]), 64)
    expected = blur_gains(sharp.radii_cpp)[knot]
    # Beyond, what the window leaks from coarser waves outweighs what is left.
    clear = expected > 0.03
    for name in ("relief", "albedo"):
        found = getattr(blurred, name).mean(axis=1) / getattr(sharp, name).mean(axis=1)
        np.testing.assert_allclose(found[clear], expected[clear], rtol=0.15)


def test_a_blurred_surface_fills_in_pixels_that_are_not_valid(stationary) -> None:
    surface = stationary("malv", seed=1)
    hole = np.s_[40:60, 30:70]
    valid = surface.valid.copy()
    valid[hole] = False
    wild = surface.p.copy()
    wild[hole] = 50.0
    blurred = blurred_surface(replace(surface, p=wild, valid=valid), 1.0)
    assert blurred.valid.all()
    assert np.abs(blurred.p[hole]).max() < np.abs(surface.p).max()
    assert np.square(blurred.p).mean() < np.square(surface.p).mean()


def difference_at(variance_px2: float, test, test_curve, reference, curve):
    """The difference that `min_over_blurs` describes, written down directly."""

    def between(changes: np.ndarray, variance: float) -> np.ndarray:
        knots = (0.0, *KNOTS_PX2)
        rows = np.concatenate([np.zeros((1, changes.shape[1])), changes])
        return np.array([np.interp(variance, knots, column) for column in rows.T])

    if variance_px2 >= 0.0:
        return test - reference - between(curve, variance_px2)
    found = test - reference
    found[:RINGS] += between(test_curve, -variance_px2)[:RINGS]
    found[RINGS:] -= curve[0, RINGS:] * variance_px2 / KNOTS_PX2[0]
    return found


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-1.69, 4.0), st.sampled_from([0.0, 0.3, 3.0]))
def test_the_least_distance_is_that_of_trying_all_blurs(
    seed: int, true_px2: float, noise: float
) -> None:
    rng = np.random.default_rng(seed)
    reference = rng.standard_normal(NUMBERS)
    test_curve, curve = (np.cumsum(rng.standard_normal((3, NUMBERS)), axis=0) for _ in range(2))
    test = -difference_at(true_px2, np.zeros(NUMBERS), test_curve, reference, curve)
    test += noise * rng.standard_normal(NUMBERS)
    arrays = [np.float32(each) for each in (test, test_curve, reference[None], curve[None])]
    penalty = blur_penalty(256**2)
    least, variances = min_over_blurs(*arrays, RINGS, penalty)
    tried_px2 = np.linspace(-(MAX_SHARPER_PX**2), MAX_BLURRIER_PX**2, 1201)
    tried = [
        np.square(difference_at(v, test, test_curve, reference, curve)).sum() + penalty * abs(v)
        for v in tried_px2
    ]
    assert least[0] == pytest.approx(min(tried), rel=1e-2, abs=1e-3)
    assert least[0] <= min(tried) + 1e-4 * (1.0 + min(tried))
    assert -(MAX_SHARPER_PX**2) - 1e-6 <= variances[0] <= MAX_BLURRIER_PX**2 + 1e-6
    at_found = difference_at(float(variances[0]), test, test_curve, reference, curve)
    assert np.square(at_found).sum() + penalty * abs(variances[0]) == pytest.approx(
        least[0], rel=1e-3, abs=1e-4
    )


def test_equal_features_have_no_blur_and_no_distance() -> None:
    rng = np.random.default_rng(0)
    features, curve = (rng.standard_normal(shape).astype(np.float32) for shape in ((1, 9), (3, 9)))
    least, variances = min_over_blurs(
        features[0], curve, features, curve[None], 4, blur_penalty(64**2)
    )
    assert least[0] == variances[0] == 0.0
