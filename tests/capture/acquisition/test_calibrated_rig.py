"""Captures with a rig whose lights are near and unequal, and calibrated."""

from dataclasses import replace

import numpy as np
import pytest

from capture import CapturedSet, SetRejected, capture_set
from capture.acquisition.light_checks import check_agreement, check_order
from capture.calibration.ps4cal import CalibrationFile, PartRecord
from capture.calibration.setting import Setting
from capture.errors import CalibrationError
from capture.sets.image_checks import LightImages
from classify.calibration.lights import CalibratedLights
from classify.lighting import Lighting
from classify.lights.flat_field import FlatField, coordinates, exponents, powers
from rig import Placement, Rig, RigConfig, open_rig

LEVELS = (1.0, 0.9, 1.05, 0.85)
DISTANCE_PX = 2.5 * 128
CONFIG = RigConfig().with_changes(
    camera={"width_px": 128, "height_px": 128, "exposure_ms": 15.0},
    simulation={
        "led_distance_px": DISTANCE_PX,
        "led_levels": LEVELS,
        "placement": {"surface": "plate"},
    },
)


def fitted(plate: CapturedSet) -> FlatField:
    """Least squares fit of degree 6 to the logarithm of the images of a sheet."""
    assert plate.ambient is not None
    shape = plate.images.shape[1:]
    x, y = coordinates(np.arange(shape[0]), np.arange(shape[1]), shape)
    i, j = exponents(6)
    terms = (powers(y, 7)[:, None, i] * powers(x, 7)[None, :, j]).reshape(-1, i.size)
    values = np.log(plate.images.astype(float) - plate.ambient).reshape(4, -1)
    values -= values.mean()
    coefficients = np.zeros((4, 7, 7))
    coefficients[:, i, j] = np.linalg.lstsq(terms, values.T, rcond=None)[0].T
    return FlatField(coefficients, np.stack([values.min(axis=1), values.max(axis=1)], axis=1))


@pytest.fixture(scope="module")
def calibration() -> CalibrationFile:
    """Flat field and positions of the rig of `CONFIG`."""
    with open_rig(CONFIG) as rig:
        plate = capture_set(rig, average=4, is_target=True)
        record = PartRecord(setting=Setting.of_rig(rig), quality="", source=("captured",))
    near = Lighting.near(DISTANCE_PX * rig.lighting.directions)
    lights = CalibratedLights(near, "plate", np.zeros(4), np.zeros(4), 0.0, 1.0)
    flat = CalibrationFile().with_part("flat_field", fitted(plate), record)
    return flat.with_part("lights", lights, record)


def rig_with(surface: str, **camera: object) -> Rig:
    placement = Placement(surface=surface).model_dump()
    return open_rig(CONFIG.with_changes(camera=camera, simulation={"placement": placement}))


@pytest.mark.parametrize("surface", ["rock", "sand", "malv"])
def test_a_calibrated_rig_is_not_rejected_for_its_lights(
    surface: str, calibration: CalibrationFile
) -> None:
    with rig_with(surface) as rig:
        captured = capture_set(rig, calibration=calibration)
    assert captured.metadata.calibration_ids == (calibration.hash,)
    assert captured.metadata.failed_attempts == ()
    assert captured.metadata.checks.light_levels == pytest.approx([1.0] * 4, abs=0.02)
    assert not captured.metadata.checks.retaken


def test_a_calibrated_rig_is_still_rejected_for_a_fault(calibration: CalibrationFile) -> None:
    with rig_with("rock") as rig:
        captured = capture_set(rig, calibration=calibration)
    names, pixels = ("a", "b", "c", "d"), captured.images.astype(np.uint16)
    images = LightImages(
        pixels, captured.ambient, None, captured.lighting, names, captured.metadata.full_scale, None
    )
    weak = images.images.copy()
    weak[2] = captured.ambient + 0.9 * (weak[2].astype(float) - captured.ambient)
    with pytest.raises(SetRejected, match=r"c gives (89|90|91)% of the others' light"):
        check_agreement(replace(images, images=weak).calibrated(calibration.calibration))
    swapped = replace(images, images=np.ascontiguousarray(pixels[[0, 3, 2, 1]]))
    exchanged = swapped.calibrated(replace(calibration.calibration, flat_field=None, lights=None))
    with pytest.raises(SetRejected, match="not in the order"):
        check_order(exchanged)


def test_a_capture_refuses_the_calibration_of_another_setting(
    calibration: CalibrationFile,
) -> None:
    other_size = pytest.raises(CalibrationError, match="96 x 128 px instead of 128 x 128 px")
    with rig_with("rock", width_px=96) as rig, other_size:
        capture_set(rig, calibration=calibration)
    with rig_with("rock", exposure_ms=10.0) as rig:  # another exposure is another brightness only
        assert capture_set(rig, calibration=calibration).metadata.calibration_ids
