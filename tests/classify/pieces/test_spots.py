"""Spots: what a fault changes around it does not excuse it."""

import cv2
import numpy as np

from classify.defects.shapes import blot
from classify.pieces.features import CELL_PX, MOMENTS, band_moments
from classify.pieces.spots import DEPARTURES, SPOT_VALUES, SpotModel, spot_values
from tests.classify.conftest import estimate

SIDE = 256
# The last values: joints in four directions and three octaves.
JOINTS = 12


def test_a_hole_leaves_the_ends_of_the_joint_that_it_interrupts() -> None:
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2.0
    joint = 0.5 * np.sin(0.5 * y) * np.exp(-0.03 * y * y)
    hole = blot(40.0, x, y).value
    middle = SIDE // CELL_PX // 2 - 3  # without the margin of three cells
    floors = np.full(MOMENTS, 1e-6, np.float32)
    whole, cut = (
        spot_values(band_moments(estimate(0.0 * x, q, 0.5 + 0.0 * x)), floors, 0.0)
        for q in (joint, joint * (1.0 - hole))
    )
    change = (whole - cut)[:, middle, middle]
    assert change[: SPOT_VALUES - JOINTS].max() > 1.0
    along = whole[-JOINTS:, middle, middle].reshape(4, -1)[:, 0].argmax()
    assert abs(change[-JOINTS:].reshape(4, -1)[along]).max() < 0.1


def level_fields(draw: np.random.Generator, count: int) -> np.ndarray:
    """Log albedo of cells, with more power in coarse waves; all other moments are noise."""
    moments = draw.uniform(0.9, 1.1, (count, 64, 64, MOMENTS)).astype(np.float32)
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(64), np.fft.fftfreq(64)))
    white = np.fft.fft2(draw.normal(size=(count, 64, 64)))
    moments[..., -1] = 0.1 * np.fft.ifft2(white / (k + 0.02)).real
    return moments


def test_the_filter_of_stains_is_as_good_as_any_linear_one_of_its_values() -> None:
    draw = np.random.default_rng(1)
    floors = np.zeros(MOMENTS, np.float32)
    good = level_fields(draw, 24)
    values = np.hstack([spot_values(part, floors, 0.0).reshape(SPOT_VALUES, -1) for part in good])
    y, x = np.mgrid[:512, :512] - 260.0  # the middle of a cell
    stain = np.log1p(-0.3 * blot(60.0, x, y).value)
    cells = cv2.resize(cv2.blur(stain, (10, 10)), (64, 64), interpolation=cv2.INTER_AREA)
    stained = good.copy()
    stained[..., -1] += 3.0 * cells.astype(np.float32)
    middle = 32 - 3
    change = np.mean([
        (spot_values(bad, floors, 0.0) - spot_values(part, floors, 0.0))[:, middle, middle]
        for part, bad in zip(good[:2], stained, strict=False)
    ], axis=0)  # fmt: skip
    covariance = np.cov(values)
    covariance += 0.01 * np.diag(np.diag(covariance))
    bound = np.sqrt(change @ np.linalg.solve(covariance, change))
    stains = SpotModel.of(values).weights[:, DEPARTURES.index("stain")]
    assert abs(stains @ change) / (stains @ values).std() > 0.9 * bound
