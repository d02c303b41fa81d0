"""A rig is compared with its calibration: by the doctor, and at the start of a session."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture import capture_set
from capture.calibration.ps4cal import CalibrationFile
from capture.procedures.plate_parts import SHEET_BRIGHTNESS
from capture.procedures.rig_check import check_calibration, drift_of_rig
from rig import Rig, RigConfig, open_rig


@pytest.fixture(scope="module")
def calibration(near_calibration: CalibrationFile, near_config: RigConfig) -> CalibrationFile:
    """The calibration of the near rig with the brightness of its sheet."""
    with open_rig(near_config) as rig:
        captured = capture_set(rig, is_target=True)
    assert captured.ambient is not None
    light = captured.images.astype(np.float64) - captured.ambient
    brightness = float(np.exp(np.log(light).mean())) / captured.metadata.full_scale
    record = near_calibration.records["flat_field"].model_copy(
        update={"figures": {SHEET_BRIGHTNESS: brightness}}
    )
    return near_calibration.with_part("flat_field", near_calibration.calibration.flat_field, record)


def near_rig(near_config: RigConfig, **simulation: Any) -> Rig:
    return open_rig(near_config.with_changes(simulation=simulation))


def test_an_unchanged_rig_with_another_sheet_shows_no_drift(
    near_config: RigConfig, calibration: CalibrationFile
) -> None:
    placement = {"surface": "rock", "seed": 9, "rotate_deg": 70.0}
    with near_rig(near_config, placement=placement) as rig:
        drift = drift_of_rig(rig, calibration)
        assert rig.simulation is not None
        assert rig.simulation.placement is not None
        assert rig.simulation.placement.surface == "rock"  # put back
    assert (drift.status, drift.causes) == ("ok", ())
    assert drift.brightness == pytest.approx(1.0, abs=0.05)


def test_another_exposure_time_is_named_and_is_no_drift(
    near_config: RigConfig, calibration: CalibrationFile, tmp_path: Path
) -> None:
    path = tmp_path / "rig.ps4cal"
    calibration.write(path)
    shorter = near_config.with_changes(camera={"exposure_ms": 9.0})
    with open_rig(shorter.model_copy(update={"calibration": str(path)})) as rig:
        checks = {check.name: check for check in check_calibration(rig, has_sheet=False)}
    assert checks["exposure of the calibration"].seen.startswith("9 ms")
    assert {name: check.status for name, check in checks.items()} == {
        "calibration": "ok", "exposure of the calibration": "warning", "sheet": "ok",
    }  # fmt: skip


def test_a_rig_without_calibration_has_nothing_to_check(near_config: RigConfig) -> None:
    with near_rig(near_config) as rig:
        assert list(check_calibration(rig, has_sheet=False)) == []
        (check,) = check_calibration(rig, has_sheet=True)
    assert check.status == "unknown"


@pytest.fixture
def rig_toml(tmp_path: Path, calibration: CalibrationFile) -> Path:
    """The near rig, as a file that names its calibration."""
    calibration.write(tmp_path / "rig.ps4cal")
    path = tmp_path / "rig.toml"
    path.write_text(
        "calibration = 'rig.ps4cal'\n[lights]\nport = 'simulated'\n"
        "[camera]\nwidth_px = 128\nheight_px = 128\nexposure_ms = 15.0\n"
        "[simulation]\nled_distance_px = 320.0\nled_levels = [1, 0.9, 1.05, 0.85]\n"
    )
    return path


def test_the_doctor_checks_the_calibration_of_the_rig(
    ps4rig: Callable[..., Any], rig_toml: Path
) -> None:
    done = ps4rig("rig", "doctor", "--rig", rig_toml, "--json")
    checks = {check["name"]: check for check in json.loads(done.stdout)["checks"]}
    assert checks["calibration"]["status"] == "ok"
    assert checks["sheet"]["status"] == "ok"
    assert done.exit_code == 0


def test_a_part_instead_of_the_sheet_is_a_fault(
    near_config: RigConfig, calibration: CalibrationFile, tmp_path: Path
) -> None:
    path = tmp_path / "rig.ps4cal"
    calibration.write(path)
    config = near_config.with_changes(simulation={"placement": {"surface": "rock"}})
    with open_rig(config.model_copy(update={"calibration": str(path)})) as rig:
        as_if_real = replace(rig, simulation=None)
        unasked = {check.name: check for check in check_calibration(as_if_real, has_sheet=False)}
        checks = {check.name: check for check in check_calibration(as_if_real, has_sheet=True)}
    assert unasked["sheet"].status == "unknown"
    assert "--sheet" in unasked["sheet"].advice
    assert checks["sheet"].status == "fault"
    assert "white matt sheet" in checks["sheet"].seen


def test_the_doctor_fails_where_an_led_has_drifted_or_the_file_is_missing(
    ps4rig: Callable[..., Any], rig_toml: Path
) -> None:
    text = rig_toml.read_text()
    rig_toml.write_text(text.replace("1.05", "0.8"))
    done = ps4rig("rig", "doctor", "--rig", rig_toml, "--json")
    checks = {check["name"]: check for check in json.loads(done.stdout)["checks"]}
    assert checks["drift: led level, light 2"]["status"] == "fault"
    assert "24% less" in checks["drift: led level, light 2"]["seen"]
    assert done.exit_code == 1
    rig_toml.write_text(text.replace("rig.ps4cal", "other.ps4cal"))
    done = ps4rig("rig", "doctor", "--rig", rig_toml, "--json")
    checks = {check["name"]: check for check in json.loads(done.stdout)["checks"]}
    assert checks["calibration"]["status"] == "fault"
    assert "other.ps4cal" in checks["calibration"]["seen"]
    assert done.exit_code == 1
