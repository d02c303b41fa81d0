"""Captured sets as values: validation and solving."""

from collections.abc import Callable

import numpy as np
import pytest

from capture import CapturedSet, capture_set
from classify.errors import InputError
from rig import Rig


def test_pixels_of_another_shape_or_type_are_refused(made_set: Callable[..., CapturedSet]) -> None:
    images = np.zeros((4, 3, 2), np.uint16)
    good = made_set(images, images[0])
    for wrong in (images[:3], images.astype(np.uint8), images[0]):
        with pytest.raises(InputError, match="a set of 4 lights needs"):
            CapturedSet(wrong, None, good.metadata)
    for wrong in (images[0, :2], images[0].astype(np.float32)):
        with pytest.raises(InputError, match="the ambient image is"):
            CapturedSet(images, wrong, good.metadata)


def test_solving_subtracts_the_ambient_light(rig: Rig) -> None:
    captured = capture_set(rig)
    assert rig.simulation is not None
    truth = rig.simulation.camera.scene
    surface = captured.solve("least_squares")
    lit = surface.valid & ~truth.shadowed.any(axis=0)
    assert lit.mean() > 0.3
    for found, true in ((surface.p, truth.p), (surface.q, truth.q)):
        assert np.corrcoef(found[lit], true[lit])[0, 1] > 0.99


def test_more_than_four_lights_are_solved_by_least_squares(
    made_set: Callable[..., CapturedSet],
) -> None:
    five = made_set(np.full((5, 4, 4), 900, np.uint16))
    assert five.solve().method == "least_squares"
    assert made_set(np.full((4, 4, 4), 900, np.uint16)).solve().method == "ps4_robust"
    with pytest.raises(InputError, match="ps4_robust needs exactly 4 lights, this set has 3"):
        made_set(np.full((3, 4, 4), 900, np.uint16)).solve()
