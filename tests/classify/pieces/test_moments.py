"""Moments of cells: energies of the right octave, directions, and parts of any size."""

import numpy as np
import pytest

from classify.base.errors import InputError
from classify.pieces.features import (
    CELL_PX,
    MOMENTS,
    OCTAVES,
    PRODUCTS,
    band_moments,
    energy_floors,
    window_features,
    window_moments,
)
from classify.pieces.piece_model import _raise_cells
from tests.classify.conftest import estimate

SIDE = 256


def wave(length_px: float, direction_deg: float):
    """Slopes and albedo of a plane wave, y up."""
    x, y = np.arange(SIDE), -np.arange(SIDE)[:, None]
    angle = np.radians(direction_deg)
    phase = 2.0 * np.pi / length_px * (np.cos(angle) * x + np.sin(angle) * y)
    slope = 0.3 * np.cos(phase)
    return estimate(np.cos(angle) * slope, np.sin(angle) * slope, 0.5 + 0.05 * np.sin(phase))


@pytest.mark.parametrize(("octave", "length_px"), [(0, 7.0), (1, 16.0), (2, 34.0), (3, 72.0)])
def test_a_wave_has_its_energy_in_its_octave(octave: int, length_px: float) -> None:
    moments = band_moments(wave(length_px, 30.0))[2:-2, 2:-2].mean(axis=(0, 1))
    for first in (0, 5):  # slopes, then log albedo
        energies = moments[2 + first : -3 : PRODUCTS]
        assert int(energies.argmax()) == octave


def test_the_finest_octave_is_what_two_pixels_lose() -> None:
    checks = np.where((np.indices((SIDE, SIDE)).sum(axis=0) % 2) == 0, 0.2, -0.2)
    moments = band_moments(estimate(checks, 0.0 * checks, 0.5 + 0.5 * checks))
    np.testing.assert_allclose(moments[..., 0], 0.04, rtol=1e-5)
    np.testing.assert_allclose(moments[..., 1], 0.04, rtol=1e-5)
    np.testing.assert_allclose(moments[..., 2:-3], 0.0, atol=1e-9)


def test_features_of_a_window_turn_with_the_texture() -> None:
    angles = (20.0, 65.0)
    features = []
    for angle_deg in angles:
        moments = window_moments(band_moments(wave(7.0, angle_deg)), 8)[1, 1]
        features.append(window_features(moments, np.zeros(MOMENTS, np.float32), angle_deg)[0])
    strong = 2 + np.arange(6)  # the octave of the wave
    np.testing.assert_allclose(features[0][strong], features[1][strong], atol=0.05)


def test_the_level_of_a_joint_hardly_depends_on_where_it_crosses_the_cells() -> None:
    """A joint near the pixel axes runs along the border of cells, and then along their middle."""
    x, y = np.arange(SIDE) - SIDE / 2, SIDE / 2 - np.arange(SIDE)[:, None]
    angle = np.radians(9.0)
    across = np.sin(angle) * x - np.cos(angle) * y
    flat = np.zeros((SIDE, SIDE))
    levels = band_moments(estimate(flat, flat, 0.5 - 0.2 * np.exp(-0.125 * across**2)))[..., -1]
    darkest = levels[:, 2:-2].min(axis=0)
    assert darkest.std() < 0.14 * abs(darkest.mean())


def test_a_part_that_is_no_multiple_of_a_cell_has_whole_cells_alone() -> None:
    random = np.random.default_rng(1).normal(0.0, 0.1, (2, 300, 171))
    surface = estimate(*random, np.full(random[0].shape, 0.5))
    assert band_moments(surface).shape == (288 // CELL_PX, 160 // CELL_PX, MOMENTS)
    assert np.isfinite(band_moments(surface)).all()


def test_a_part_smaller_than_the_largest_window_is_refused() -> None:
    flat = np.zeros((127, 300))
    with pytest.raises(InputError, match="300 x 127 px"):
        band_moments(estimate(flat, flat, flat + 0.5))


def test_only_energies_have_floors() -> None:
    floors = energy_floors(np.ones(MOMENTS, np.float32))
    assert np.count_nonzero(floors) == 2 * (OCTAVES + 1)


def test_every_cell_gets_the_largest_score_of_the_windows_around_it() -> None:
    cells = np.zeros((5, 4), np.float32)
    _raise_cells(cells, np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]], np.float32), 2)
    np.testing.assert_array_equal(
        cells, [[1, 2, 3, 3], [4, 5, 6, 6], [7, 8, 9, 9], [10, 11, 12, 12], [10, 11, 12, 12]]
    )
