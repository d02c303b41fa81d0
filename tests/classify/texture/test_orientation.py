"""The circular shift between polar spectra, against brute force."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from classify.texture.orientation import best_shift, roll_angles, squared_errors_by_shift
from classify.texture.spectra import ANGLES

SEEDS = st.integers(0, 2**32 - 1)


def bumps(shift: float, count: int = ANGLES) -> np.ndarray:
    """A band-limited polar spectrum, shifted by `shift` steps."""
    angle = 2 * np.pi * (np.arange(count) - shift) / count
    return 3 + np.cos(angle) + 0.6 * np.cos(2 * angle + 1) + 0.3 * np.sin(5 * angle)


@given(SEEDS, st.integers(1, 4), st.sampled_from([(), (1,), (3,), (2, 4)]), st.integers(2, 24))
def test_errors_by_shift_are_those_of_brute_force(
    seed: int, references: int, between: tuple[int, ...], count: int
) -> None:
    rng = np.random.default_rng(seed)
    test = rng.random((*between, count))
    stored = rng.random((references, *between, count)).astype(np.float32)
    errors = squared_errors_by_shift(test, stored)
    assert errors.shape == (references, count)
    for j in range(count):
        difference = np.roll(test, -j, axis=-1) - stored
        expected = (difference**2).reshape(references, -1).sum(axis=1)
        np.testing.assert_allclose(errors[:, j], expected, atol=1e-9)


@given(st.floats(0, ANGLES, exclude_max=True))
def test_a_shift_between_steps_is_found_to_a_fiftieth_of_a_step(shift: float) -> None:
    errors = squared_errors_by_shift(bumps(shift), bumps(0.0)[None])
    found = best_shift(errors)[0]
    assert abs((found - shift + ANGLES / 2) % ANGLES - ANGLES / 2) < 0.02


def test_the_shift_is_finite_without_a_direction() -> None:
    flat = np.ones(ANGLES)
    shifts = best_shift(squared_errors_by_shift(flat, np.stack([flat, 2 * flat])))
    assert np.isfinite(shifts).all()
    assert ((shifts >= 0) & (shifts < ANGLES)).all()


@given(st.floats(-200, 200), st.sampled_from([(), (4,), (2, 3)]))
def test_a_band_limited_spectrum_is_shifted_exactly(shift: float, before: tuple[int, ...]) -> None:
    stack = np.broadcast_to(bumps(shift), (*before, ANGLES))
    back = roll_angles(stack, np.array([shift, 0.0]))
    assert back.shape == (2, *before, ANGLES)
    np.testing.assert_allclose(back[0], np.broadcast_to(bumps(0.0), stack.shape), atol=1e-9)
    np.testing.assert_allclose(back[1], stack, atol=1e-9)
