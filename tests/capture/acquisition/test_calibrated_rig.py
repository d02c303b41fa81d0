"""Captures with a rig whose lights are near and unequal, and calibrated."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture import CapturedSet, SetRejected, capture_set
from capture.acquisition.light_checks import check_set
from capture.base.errors import CalibrationError
from capture.calibration.ps4cal import CalibrationFile
from capture.sets.image_checks import CheckedImages
from rig import Placement, Rig, RigConfig, open_rig


@pytest.fixture
def rig_with(near_config: RigConfig) -> Callable[..., Rig]:
    """Open the near rig with a surface, and with other values of its camera."""

    def opened(surface: str, **camera: object) -> Rig:
        placement = Placement(surface=surface).model_dump()
        return open_rig(
            near_config.with_changes(camera=camera, simulation={"placement": placement})
        )

    return opened


@pytest.mark.parametrize("surface", ["rock", "sand", "malv"])
def test_a_calibrated_rig_is_not_rejected_for_its_lights(
    surface: str, near_calibration: CalibrationFile, rig_with: Callable[..., Rig]
) -> None:
    with rig_with(surface) as rig:
        captured = capture_set(rig, calibration=near_calibration)
    assert captured.metadata.calibration_ids == (near_calibration.hash,)
    assert captured.metadata.failed_attempts == ()
    assert captured.metadata.checks.light_levels == pytest.approx([1.0] * 4, abs=0.02)
    assert not captured.metadata.checks.retaken


def test_a_calibrated_rig_is_still_rejected_for_a_fault(
    near_calibration: CalibrationFile, rig_with: Callable[..., Rig]
) -> None:
    with rig_with("rock") as rig:
        captured = capture_set(rig, calibration=near_calibration)
    names, pixels = ("a", "b", "c", "d"), captured.images.astype(np.uint16)
    images = CheckedImages(
        pixels, captured.ambient, None, captured.lighting, names, captured.metadata.full_scale, None
    )
    weak = images.images.copy()
    weak[2] = captured.ambient + 0.9 * (weak[2].astype(float) - captured.ambient)
    with pytest.raises(SetRejected, match=r"c gives (89|90|91)% "):
        check_set(replace(images, images=weak), near_calibration.calibration, lambda: weak)
    exchanged = np.ascontiguousarray(pixels[[0, 3, 2, 1]])
    without_lights = replace(near_calibration.calibration, flat_field=None, lights=None)
    with pytest.raises(SetRejected, match="not in the order"):
        check_set(replace(images, images=exchanged), without_lights, lambda: exchanged)


def test_the_calibration_of_the_rig_is_used_and_kept_without_being_named(
    near_config: RigConfig, near_calibration: CalibrationFile, tmp_path: Path
) -> None:
    (tmp_path / "sets").mkdir()
    near_calibration.write(tmp_path / "rig.ps4cal")
    named = near_config.model_copy(update={"calibration": str(tmp_path / "rig.ps4cal")})
    with open_rig(named.with_changes(simulation={"placement": {"surface": "rock"}})) as rig:
        assert capture_set(rig, is_target=True).metadata.calibration_ids == ()
        captured = capture_set(rig)
    assert captured.metadata.calibration_ids == (near_calibration.hash,)
    captured.save(tmp_path / "sets" / "rock.ome.tif")
    (tmp_path / "rig.ps4cal").unlink()
    loaded = CapturedSet.load(tmp_path / "sets" / "rock.ome.tif")
    np.testing.assert_array_equal(loaded.solve().p, captured.solve().p)
    assert np.abs(loaded.solve().p - loaded.solve(raw=True).p).mean() > 0.05


def test_a_capture_refuses_the_calibration_of_another_setting(
    near_calibration: CalibrationFile, rig_with: Callable[..., Rig]
) -> None:
    other_size = pytest.raises(CalibrationError, match="96 x 128 px instead of 128")
    with rig_with("rock", width_px=96) as rig, other_size:
        capture_set(rig, calibration=near_calibration)
    with rig_with("rock", exposure_ms=10.0) as rig:  # another exposure is another brightness only
        assert capture_set(rig, calibration=near_calibration).metadata.calibration_ids
