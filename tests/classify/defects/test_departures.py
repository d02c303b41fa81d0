"""Departures of cells: sums along lines, nearest good cells, evidence."""

import numpy as np
import pytest

from classify.defects.departures import CENTRES, EvidenceModel, GoodCells
from classify.defects.filters import DIRECTIONS, LENGTHS, line_response


def _responses(field: np.ndarray, cell: int, orientation_deg: float) -> np.ndarray:
    """(directions, lengths, h, w) responses, each alone."""
    alone = np.eye(DIRECTIONS * LENGTHS, dtype=np.float32)
    found = np.array([line_response(field, cell, orientation_deg, weights) for weights in alone])
    return found.reshape(DIRECTIONS, LENGTHS, *found.shape[1:])


@pytest.mark.parametrize("cell", [2, 4])
@pytest.mark.parametrize(("vertical", "direction"), [(False, 0), (True, DIRECTIONS // 2)])
def test_a_line_of_ones_has_the_sum_of_the_weights_in_its_direction(
    cell: int, vertical: bool, direction: int
) -> None:
    field = np.zeros((160, 96), np.float32)
    field[:, 48] = vertical
    field[80, :] += not vertical
    here = _responses(field, cell, 0.0)[:, :, 80 // cell, 48 // cell]
    np.testing.assert_array_equal(here[direction], [12.0, 27.0, 45.0])
    assert (np.delete(here, direction, axis=0)[:, 2] <= 0.5 * 45.0).all()


def test_lines_turn_with_the_orientation() -> None:
    field = np.random.default_rng(0).normal(size=(64, 64)).astype(np.float32)
    here, there = _responses(field, 4, 0.0), _responses(field, 4, 30.0)
    np.testing.assert_allclose(there, np.roll(here, -2, axis=0), rtol=1e-5)


def test_the_response_is_the_largest_of_the_weighted_ones() -> None:
    rng = np.random.default_rng(0)
    field = rng.normal(size=(64, 64)).astype(np.float32)
    weights = rng.uniform(0.5, 2.0, DIRECTIONS * LENGTHS).astype(np.float32)
    alone = _responses(field, 4, 10.0).reshape(-1, 16, 16)
    expected = np.max(weights[:, None, None] * alone, axis=0)
    np.testing.assert_allclose(line_response(field, 4, 10.0, weights), expected, rtol=1e-5)


def test_a_cell_between_two_kinds_of_good_cells_is_far_from_both() -> None:
    rng = np.random.default_rng(0)
    joint, brick = rng.normal(0.0, 0.1, (2, 3000, 4)).astype(np.float32)
    cells = GoodCells.of([joint, brick + np.float32(4.0)])
    places = np.array([[[0.0] * 4, [4.0] * 4, [2.0] * 4]], np.float32)
    at_joint, at_brick, between = cells.squared_distances(places)[0]
    assert cells.centres.shape == (CENTRES, 4)
    assert max(at_joint, at_brick) < 0.2 * between
    nearest = np.sum((cells.centres - (places[0, 2] - cells.mean) @ cells.whitening) ** 2, axis=1)
    assert between == pytest.approx(nearest.min(), rel=1e-4)


def test_evidence_is_the_negative_logarithm_of_the_share_beyond() -> None:
    values = np.random.default_rng(0).exponential(2.0, (1, 200_000)).astype(np.float32)
    places = np.array([[[0.0, 1.0, 5.0, 40.0]]], np.float32)
    found = EvidenceModel.learn(values).of(places)[0, 0]
    np.testing.assert_allclose(found, places[0, 0] / 2.0, rtol=0.05, atol=0.01)
