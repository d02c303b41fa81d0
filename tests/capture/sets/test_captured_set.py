"""Captured sets as values: validation and solving."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from capture import CapturedSet, capture_set
from classify import Lighting, Method
from classify.base.errors import InputError
from classify.calibration.calibration import CalibratedLights, Calibration
from classify.lights.near_light import sheet_of
from rig import Rig


def test_pixels_of_another_shape_or_type_are_refused(made_set: Callable[..., CapturedSet]) -> None:
    images = np.zeros((4, 3, 2), np.uint16)
    good = made_set(images, images[0])
    for wrong in (images[:3], images.astype(np.uint8), images[0]):
        with pytest.raises(InputError, match="4 lights needs"):
            CapturedSet(wrong, None, good.metadata)
    for wrong in (images[0, :2], images[0].astype(np.float32)):
        with pytest.raises(InputError, match="the ambient image is"):
            CapturedSet(images, wrong, good.metadata)


@pytest.mark.parametrize("method", ["ps4", "ps4_robust", "least_squares"])
def test_nothing_is_valid_or_in_shadow_outside_the_mask(
    rig: Rig, made_set: Callable[..., CapturedSet], method: Method
) -> None:
    captured = capture_set(rig)
    mask = np.zeros(captured.images.shape[1:], np.bool_)
    mask[10:40, 20:50] = True
    images, ambient, lighting = captured.images, captured.ambient, captured.lighting
    whole = made_set(images, ambient, lighting, bit_depth=12, full_scale=4095).solve(method)
    part = made_set(images, ambient, lighting, mask, bit_depth=12, full_scale=4095).solve(method)
    np.testing.assert_array_equal(part.valid, whole.valid & mask)
    np.testing.assert_array_equal(part.p, np.where(mask, whole.p, 0.0))
    np.testing.assert_array_equal(part.q, np.where(mask, whole.q, 0.0))
    np.testing.assert_array_equal(part.shadow_mask, whole.shadow_mask & mask)
    np.testing.assert_array_equal(part.specular, whole.specular & mask)


def test_a_saved_set_keeps_the_positions_of_its_lights(
    made_set: Callable[..., CapturedSet], tmp_path: Path
) -> None:
    lighting = Lighting.near(700.0 * Lighting.ring(40.0).directions, [1.0, 0.9, 1.0, 1.1])
    captured = made_set(np.zeros((4, 3, 2), np.uint16), lighting=lighting)
    captured.save(tmp_path / "near.ome.tif")
    assert CapturedSet.load(tmp_path / "near.ome.tif").lighting == lighting


def test_a_calibration_without_a_flat_field_still_has_the_lobes_of_its_leds(
    made_set: Callable[..., CapturedSet],
) -> None:
    lighting = Lighting.near(100.0 * Lighting.ring(45.0).directions)
    sheet = sheet_of(lighting, (48, 64), 8.0).strengths(np.arange(48), np.arange(64), (48, 64))
    lights = CalibratedLights(lighting, "plate", np.ones(4), np.full(4, 0.01), 0.001, 8.0)
    captured = made_set((10_000 * sheet).astype(np.uint16), lighting=Lighting.ring(45.0))
    surface = captured.solve("least_squares", calibration=Calibration(lights=lights))
    assert max(np.abs(surface.p).max(), np.abs(surface.q).max()) < 1e-3


def test_a_mask_has_the_shape_of_the_images_and_a_name(
    made_set: Callable[..., CapturedSet],
) -> None:
    images = np.zeros((4, 3, 2), np.uint16)
    good = made_set(images, mask=np.ones((3, 2), np.bool_))
    for wrong in (np.ones((2, 3), np.bool_), np.ones((3, 2), np.uint8)):
        with pytest.raises(InputError, match="the mask is"):
            CapturedSet(images, None, good.metadata, wrong)
    with pytest.raises(InputError, match="mask_file"):
        CapturedSet(images, None, good.metadata)
