"""Distance and turn between signatures."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import surface_spectra
from classify.orientation import roll_angles
from classify.scheme import compare, signature
from classify.spectra import ANGLES, RADII


@pytest.fixture(scope="module")
def learned(texture) -> np.ndarray:
    return signature(surface_spectra(texture("grain", seed=1)))


def test_signature_is_finite_and_of_one_size(learned) -> None:
    assert learned.shape == (2, RADII, ANGLES)
    assert learned.dtype == np.float32
    assert np.isfinite(learned).all()
    assert (learned >= 0).all()


def test_signature_holds_magnitudes(surface_of, texture) -> None:
    """Twice the slopes: twice the signature of M, the same of A."""
    surface = texture("grain", seed=1)
    one = signature(surface_spectra(surface))
    two = signature(surface_spectra(surface_of(2 * surface.p, 2 * surface.q, surface.albedo)))
    np.testing.assert_allclose(two[0], 2 * one[0], rtol=0.05, atol=1e-4)
    np.testing.assert_array_equal(two[1], one[1])


def test_a_signature_is_at_distance_zero_of_itself(learned) -> None:
    distances, turns = compare(learned, learned[None])
    assert distances[0] == pytest.approx(0.0, abs=1e-6)
    assert (turns[0] + 90) % 180 - 90 == pytest.approx(0.0, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 180))
def test_a_turned_signature_is_found_at_its_angle(learned, turn_deg: float) -> None:
    turned = roll_angles(learned, np.array([-turn_deg * ANGLES / 180.0]))[0]
    distances, turns = compare(turned.astype(np.float32), learned[None])
    assert (turns[0] - turn_deg + 90) % 180 - 90 == pytest.approx(0.0, abs=0.5)
    assert distances[0] < 0.01


@given(st.integers(0, 2**32 - 1))
def test_distances_lie_between_zero_and_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    test, *references = rng.random((4, 2, RADII, ANGLES)).astype(np.float32) ** 4
    distances, turns = compare(test, np.stack([*references, 0 * test]))
    assert ((distances >= 0) & (distances <= 1 + 1e-12)).all()
    assert ((turns >= 0) & (turns < 180)).all()
    assert distances[-1] == pytest.approx(1.0)


def test_a_rough_channel_does_not_drown_a_smooth_one(learned) -> None:
    """M a thousand times stronger in both: the distance that comes from A alone is the same."""
    other = learned.copy()
    other[1] = learned[1][::-1]
    rough = np.array([1000, 1], np.float32)[:, None, None]
    plain, _ = compare(learned, other[None])
    drowned, _ = compare(rough * learned, (rough * other)[None])
    assert plain[0] > 0.05
    assert drowned[0] == pytest.approx(plain[0], rel=1e-3)


def test_smooth_surfaces_are_alike_and_unlike_textures(learned) -> None:
    nothing = np.zeros_like(learned)
    distances, turns = compare(nothing, np.stack([nothing, learned]))
    assert distances[0] == 0.0
    assert distances[1] == pytest.approx(1.0)
    assert np.isfinite(turns).all()
