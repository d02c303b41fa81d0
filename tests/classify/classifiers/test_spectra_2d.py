"""Scheme 9.3 of the thesis: distance and orientation between 2D spectra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import SurfaceEstimate
from classify.classifiers import CLASSIFIERS
from classify.classifiers.thesis import shifts_by_polar
from classify.texture.orientation import roll_angles
from classify.texture.spectra import ANGLES, RADII

SCHEME = CLASSIFIERS["spectra_2d"]
OF_POWER = CLASSIFIERS["spectra_2d_power"]


def signature(surface: SurfaceEstimate, scheme=SCHEME) -> np.ndarray:
    return scheme.signature(scheme.observe(surface, 64), {})


def compare(test: np.ndarray, references: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = SCHEME.compare(test, references, {})
    assert found.orientations_deg is not None
    return found.distances, found.orientations_deg


@pytest.fixture(scope="module")
def learned(texture) -> np.ndarray:
    return signature(texture("grain", seed=1))


@pytest.mark.parametrize("scheme", [SCHEME, OF_POWER], ids=lambda each: each.name)
def test_signatures_are_finite_and_of_one_shape(texture, scheme) -> None:
    found = signature(texture("grain", seed=1), scheme)
    assert found.shape == (2, RADII, ANGLES)
    assert found.dtype == np.float32
    assert np.isfinite(found).all()
    assert (found >= 0).all()


def test_signatures_are_magnitudes_or_powers(surface_of, texture) -> None:
    """Double slopes double or quadruple M and leave A."""
    surface = texture("grain", seed=1)
    steeper = surface_of(2 * surface.p, 2 * surface.q, surface.albedo)
    for scheme, times in ((SCHEME, 2.0), (OF_POWER, 4.0)):
        one, two = signature(surface, scheme), signature(steeper, scheme)
        # Some slopes reach the bound.
        np.testing.assert_allclose(two[0], times * one[0], rtol=0.05, atol=1e-4)
        np.testing.assert_array_equal(two[1], one[1])
    np.testing.assert_allclose(signature(surface) ** 2, signature(surface, OF_POWER), rtol=1e-5)


def test_a_signature_is_at_distance_zero_of_itself(learned) -> None:
    distances, orientations = compare(learned, learned[None])
    assert distances[0] == pytest.approx(0.0, abs=1e-6)
    assert (orientations[0] + 90) % 180 - 90 == pytest.approx(0.0, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 180))
def test_the_orientation_of_a_rotated_signature_is_found(learned, orientation_deg: float) -> None:
    rotated = roll_angles(learned, np.array([-orientation_deg * ANGLES / 180.0]))[0]
    distances, orientations = compare(rotated.astype(np.float32), learned[None])
    assert (orientations[0] - orientation_deg + 90) % 180 - 90 == pytest.approx(0.0, abs=0.5)
    assert distances[0] < 0.01


def test_the_orientation_comes_from_the_polar_spectra_alone(learned) -> None:
    """Permuted radii have the same sums."""
    rng = np.random.default_rng(0)
    other = learned[:, rng.permutation(RADII)]
    rotated = roll_angles(other, np.array([-20.0 * ANGLES / 180.0]))[0].astype(np.float32)
    distances, orientations = compare(rotated, learned[None])
    assert (orientations[0] - 20.0 + 90) % 180 - 90 == pytest.approx(0.0, abs=0.5)
    assert distances[0] > 0.05
    np.testing.assert_allclose(shifts_by_polar(rotated, learned[None]) * 2.0, orientations)


def test_a_rough_channel_does_not_outweigh_a_smooth_one(learned) -> None:
    """The distance by A does not change when M is a thousand times stronger in both."""
    other = learned.copy()
    other[1] = learned[1][::-1]
    rough = np.array([1000, 1], np.float32)[:, None, None]
    plain, _ = compare(learned, other[None])
    rougher, _ = compare(rough * learned, (rough * other)[None])
    assert plain[0] > 0.05
    assert rougher[0] == pytest.approx(plain[0], rel=1e-3)
