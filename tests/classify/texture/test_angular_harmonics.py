"""The least error over all circular shifts, against shifting and subtracting."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from classify.texture.orientation import (
    HARMONICS,
    harmonics,
    least_error,
    roll_angles,
    shift_invariant_norms,
)
from tests.angles import off_deg

ANGLES = 90
SEEDS = st.integers(0, 2**32 - 1)
SHIFTS_DEG = st.floats(0.0, 180.0, exclude_max=True)


def smooth(seed: int, *before: int) -> np.ndarray:
    """Random maps (..., 90) without harmonics finer than those kept."""
    rng = np.random.default_rng(seed)
    fall = 0.8 ** np.arange(HARMONICS)
    series = rng.standard_normal((*before, HARMONICS, 2)) @ [1, 1j] * fall
    return np.fft.irfft(series, n=ANGLES, norm="ortho")


def shifted(maps: np.ndarray, shift_deg: float) -> np.ndarray:
    """The maps, shifted anticlockwise."""
    return roll_angles(maps, np.array([-shift_deg * ANGLES / 180.0]))[0]


@given(SEEDS)
def test_a_series_loses_the_finer_harmonics_only(seed: int) -> None:
    noise = np.random.default_rng(seed).standard_normal(ANGLES)
    coarse = np.fft.rfft(noise)
    coarse[HARMONICS:] = 0.0
    kept = np.square(np.fft.irfft(coarse, n=ANGLES)).sum()
    assert np.square(np.abs(harmonics(noise))).sum() == pytest.approx(kept, rel=1e-5)
    assert kept < np.square(noise).sum()


@settings(max_examples=100, deadline=None)
@given(SEEDS, SHIFTS_DEG, st.integers(1, 5))
def test_the_shift_of_a_map_is_found(seed: int, shift_deg: float, maps: int) -> None:
    reference = smooth(seed, maps)
    series = harmonics(reference)
    found = least_error(harmonics(shifted(reference, shift_deg)), series[None])
    energy = np.square(reference).sum()
    assert found.errors[0] <= 1e-3 * energy
    assert found.sharpness[0] > 0.98
    # Another shift may give nearly the same map.
    at_found = shifted(reference, float(found.shifts_deg[0]))
    at_true = shifted(reference, shift_deg)
    assert np.square(at_found - at_true).sum() < 2e-3 * energy


@pytest.mark.parametrize("shift_deg", [0.0, 0.3, 12.5, 89.9, 90.0, 133.37, 179.6])
def test_the_angle_is_right_to_a_tenth_of_a_degree(shift_deg: float) -> None:
    reference = smooth(5, 4)
    found = least_error(harmonics(shifted(reference, shift_deg)), harmonics(reference)[None])
    assert off_deg(found.shifts_deg[0], shift_deg) < 0.1
    assert 0.0 <= found.shifts_deg[0] < 180.0


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 4), st.integers(1, 3))
def test_least_errors_are_those_of_brute_force(seed: int, count: int, maps: int) -> None:
    """Shift by every half degree, subtract, square."""
    test, references = smooth(seed, maps), smooth(seed ^ 1, count, maps)
    found = least_error(harmonics(test), harmonics(references))
    shifts_deg = np.arange(0.0, 180.0, 0.5)
    back = roll_angles(test, shifts_deg * ANGLES / 180.0)
    for index, reference in enumerate(references):
        errors = np.square(back - reference).sum(axis=(1, 2))
        energy = np.square(test).sum() + np.square(reference).sum()
        assert found.errors[index] == pytest.approx(errors.min(), abs=2e-3 * energy)
        at_found = np.square(shifted(reference, found.shifts_deg[index]) - test).sum()
        assert at_found == pytest.approx(errors.min(), abs=2e-3 * energy)


@settings(max_examples=100, deadline=None)
@given(SEEDS, SHIFTS_DEG, st.floats(0.0, 2.0), st.floats(0.0, 100.0))
def test_no_error_is_below_the_bound_of_the_norms(
    seed: int, shift_deg: float, unlike: float, level: float
) -> None:
    """For the same map shifted, for another map, and between."""
    references = smooth(seed, 6, 3) + level
    test = shifted(references[0], shift_deg) + unlike * smooth(seed ^ 1, 3)
    series, test_series = harmonics(references), harmonics(test)
    norms = shift_invariant_norms(series)
    assert norms.shape == (6, 6)
    assert norms.dtype == np.float32
    bounds = np.square(norms - shift_invariant_norms(test_series)).sum(axis=1)
    errors = least_error(test_series, series).errors
    energy = np.square(references).sum(axis=(1, 2)) + np.square(test).sum()
    assert (errors >= bounds - 1e-5 * energy).all()


def test_sharpness_is_zero_without_a_direction() -> None:
    even = np.full((1, ANGLES), 3.0)
    directed = even + np.cos(2 * np.pi * np.arange(ANGLES) / ANGLES)
    found = least_error(harmonics(even), harmonics(np.stack([even, directed])))
    np.testing.assert_allclose(found.sharpness, 0.0, atol=1e-6)
    assert np.isfinite(found.shifts_deg).all()
    assert least_error(harmonics(directed), harmonics(directed)[None]).sharpness[0] == (
        pytest.approx(1.0, abs=1e-5)
    )


@given(SEEDS, SEEDS)
@example(252, 252)  # a shift just below 0
def test_sharpness_lies_between_zero_and_one(seed: int, other: int) -> None:
    found = least_error(harmonics(smooth(seed, 2)), harmonics(smooth(other, 5, 2)))
    assert ((found.sharpness >= 0.0) & (found.sharpness <= 1.0)).all()
    assert ((found.shifts_deg >= 0.0) & (found.shifts_deg < 180.0)).all()
    assert (found.errors >= 0.0).all()


@pytest.mark.filterwarnings("error")
def test_maps_of_zeros_are_equal_and_without_direction() -> None:
    nothing = harmonics(np.zeros((3, ANGLES)))
    found = least_error(nothing, nothing[None])
    assert found.errors.tolist() == [0.0]
    assert found.sharpness.tolist() == [0.0]
    assert np.isfinite(found.shifts_deg).all()
