"""A part with a groove under near LEDs, calibrated by its flat areas."""

import numpy as np
import pytest

from classify import Lighting, Method, integrate_gradients, photometric_stereo
from classify.calibration.plate import measure_plate
from classify.images import ImageStack
from tests.plates import Plate, ring_positions

PLATE = Plate(ring_positions(4.0), lobe=2.0, grain=0.0, noise=0.0, bits=8, shape=(192, 256))
WALL_SLOPE, WALL, FLOOR = 0.5, 0.06, 0.12


def pictures() -> tuple[ImageStack, np.ndarray, np.ndarray]:
    """Images of a vertical groove, its height, and where the part is flat."""
    x, y = PLATE.coordinates()
    p = np.zeros(PLATE.shape)
    p[np.abs(x + FLOOR / 2 + WALL / 2) < WALL / 2] = -WALL_SLOPE
    p[np.abs(x - FLOOR / 2 - WALL / 2) < WALL / 2] = WALL_SLOPE
    normal = np.stack([-p, 0.0 * p, np.ones_like(p)]) / np.sqrt(1.0 + p * p)
    height = np.cumsum(p, axis=1) * (x[0, 1] - x[0, 0])
    shades = []
    for position in PLATE.positions:
        towards = position[:, None, None] - np.stack([x, y, 0.0 * x])
        shades.append(np.maximum((normal * towards).sum(axis=0), 0.0) / towards[2])
    light = PLATE.strengths * np.array(shades)
    noise = np.random.default_rng(2).normal(0.0, 0.7, light.shape)
    values = np.rint(np.clip(110.0 * light / light.mean() + noise, 0.0, 255.0))
    return ImageStack(values.astype(np.uint8), None), height, np.abs(p) == 0.0


@pytest.mark.parametrize("method", ["least_squares", "ps4_robust"])
@pytest.mark.parametrize("masked", [False, True])
def test_a_groove_has_its_depth_and_flat_areas_stay_flat(method: Method, masked: bool) -> None:
    stack, height, flat = pictures()
    measured = measure_plate([stack], 255.0, Lighting.ring(45.0), flat if masked else None)
    assert measured.lights is not None
    field = measured.flat_field.flat_field
    assert field.largest_fall_off > 0.4
    solved = photometric_stereo(
        stack.images, measured.lights.lighting, method, full_scale=255.0, flat_field=field
    )
    found = integrate_gradients(solved.p, solved.q) * 2.0 / max(PLATE.shape)
    depth = np.median(found[:, :80]) - np.median(found[:, 122:134])
    true = height[0, 0] - height[0, 128]
    assert depth == pytest.approx(true, rel=0.05)
    sides = np.concatenate([found[:, :90], found[:, 166:]], axis=1)
    assert np.ptp(np.median(sides, axis=0)) < 0.1 * true
