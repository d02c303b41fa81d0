"""Photographs of which one is shifted against the others."""

from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.sets.light_list import load_light_list
from classify.lights.registration import shift_of_one_image

DATA = Path(__file__).parents[2] / "data"


@pytest.mark.parametrize("name", ["butterfly_crop", "cat_crop"])
def test_a_shift_of_one_photograph_is_found_and_true_ones_have_none(name: str) -> None:
    lights = load_light_list(DATA / name / "lights.json")
    paths = lights.image_paths()
    photographs = np.stack([cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths])
    black = np.zeros(photographs.shape[1:], np.uint8)
    true, shifted = [], []
    picks = [
        pick
        for count in (4, 6)
        for pick in [*combinations(range(len(paths)), count)][:: 4 * len(paths) - 30]
    ]
    for pick in picks:
        images = photographs[list(pick)]
        lighting = lights.lighting_for([paths[k] for k in pick])
        if np.linalg.svd(lighting.directions)[1][2] < 0.15:
            continue  # nearly in one plane
        true.append(shift_of_one_image(images, black, lighting, 255))
        images[1] = np.roll(images[1], 3, axis=1)
        shifted.append(shift_of_one_image(images, black, lighting, 255))
    assert true == [None] * len(true)
    found = [shift for shift in shifted if shift is not None]
    assert len(found) > 0.5 * len(shifted)
    assert np.median(found) == pytest.approx(3.0, abs=1.0)
