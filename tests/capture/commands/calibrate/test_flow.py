"""Common steps of the commands of `calibrate`: targets, their sets, and keeping a part."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.base.errors import CalibrationError
from capture.calibration.ps4cal import CalibrationFile, MeasuredPart
from capture.calibration.setting import Setting
from capture.commands.calibrate_flow import (
    Target,
    calibration_at,
    keep_parts,
    place_target,
)
from classify import InputError
from classify.calibration.calibration import Scale
from classify.calibration.dark import Dark
from rig import Rig

SHEET = Target("a white matt sheet", "plate", next_placement="rotate the sheet by 180 degrees")
SCALE = Scale(0.05, 0.001, np.eye(3), None, 0.1)


def test_a_person_is_asked_to_place_the_target(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rig.simulation, "placement", None)  # as with a real rig
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    place_target(rig, SHEET)
    assert "a white matt sheet" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"180 degrees.*give --yes"):
        place_target(rig, SHEET, again=True)
    place_target(rig, SHEET, yes=True)


def test_a_part_is_added_then_replaced_and_others_stay(
    rig: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rig.ps4cal"
    setting = Setting.of_rig(rig)
    part = MeasuredPart.now("scale", SCALE, setting, "Good.", {"mm_per_px": 0.05}, ())
    keep_parts(path, CalibrationFile(), [part], json=False)
    shown = capsys.readouterr().out
    assert "mm per px: 0.05\n" in shown
    assert f'calibration = "{path}"' in shown
    keep_parts(path, calibration_at(path), [part], json=False)
    shown = capsys.readouterr().out
    assert "scale replaced. Good." in shown
    assert "calibration =" not in shown
    keep_parts(path, calibration_at(path), [replace(part, warnings=("worn",))], json=True)
    printed = capsys.readouterr()
    assert "warning" in printed.err
    assert json.loads(printed.out)["calibration_id"] == CalibrationFile.read(path).hash


def test_a_part_that_another_program_adds_meanwhile_is_not_lost(rig: Rig, tmp_path: Path) -> None:
    path, setting = tmp_path / "rig.ps4cal", Setting.of_rig(rig)
    scale = MeasuredPart.now("scale", SCALE, setting, "Good.", {}, ())
    camera = Dark(8.0, 1.0, np.empty((0, 2), np.int32), None, 4095.0)
    dark = MeasuredPart.now("dark", camera, setting, "Good.", {}, ())
    before = calibration_at(path)
    keep_parts(path, before, [scale], json=False)  # by the other program
    with pytest.raises(InputError, match=r"rig\.ps4cal: another program"):
        keep_parts(path, before, [dark], json=False)
    keep_parts(path, calibration_at(path), [dark], json=False)
    assert CalibrationFile.read(path).records.keys() == {"scale", "dark"}
    keep_parts(path, calibration_at(path), [dark], json=False, dropped=("scale",))
    assert CalibrationFile.read(path).records.keys() == {"dark"}


def test_a_file_that_is_no_calibration_is_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "notes.ps4cal"
    path.write_text("notes")
    with pytest.raises(CalibrationError, match="not a readable calibration"):
        calibration_at(path)
    with pytest.raises(InputError, match=r"must end in \.ps4cal"):
        calibration_at(tmp_path / "rig.toml")
