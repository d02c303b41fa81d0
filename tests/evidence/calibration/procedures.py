"""Calibration of a simulated rig, measured as ``ps4rig calibrate`` does."""

from __future__ import annotations

from pathlib import Path

from capture.acquisition.frame_series import dark_of_rig, rungs_of_rig
from capture.calibration.ps4cal import CalibrationFile, MeasuredPart
from capture.calibration.setting import Setting
from capture.procedures.camera_parts import dark_part, response_parts
from capture.procedures.plate_parts import plate_parts
from classify.calibration.calibration import Calibration
from rig import Placement, Rig, Simulation, open_rig

from .rigs import Conditions, captured_targets

# Frames of each image of the sheet, and its half turn, as in capture/commands/calibrate_flow.py.
_SHEET_FRAMES = 4
_SHEET = tuple(Placement(surface="plate", rotate_deg=angle) for angle in (0.0, 180.0))
_SOURCE = ("captured",)


def calibrated(conditions: Conditions, path: Path) -> CalibrationFile:
    """Measure dark, response, plate and LED positions of a rig, and read them from their file."""
    file = CalibrationFile()
    with open_rig(conditions.faulty) as rig:
        assert rig.simulation is not None
        for measure in (_dark, _response, _plate):
            for each in measure(rig, rig.simulation, file.calibration):
                file = file.with_part(each.name, each.part, each.record)
    file.write(path)
    return CalibrationFile.read(path)


def _dark(rig: Rig, simulation: Simulation, _: Calibration) -> list[MeasuredPart]:
    simulation.place(Placement(surface="lens_cap"))
    found = dark_of_rig(rig)
    return [dark_part(found, found.dark, Setting.of_rig(rig), _SOURCE)]


def _response(rig: Rig, simulation: Simulation, calibration: Calibration) -> list[MeasuredPart]:
    simulation.place(_SHEET[0])
    rungs = rungs_of_rig(rig, calibration)
    return response_parts(rungs, calibration, Setting.of_rig(rig), _SOURCE)


def _plate(rig: Rig, _: Simulation, calibration: Calibration) -> list[MeasuredPart]:
    sets = list(captured_targets(rig, _SHEET, _SHEET_FRAMES))
    return plate_parts(sets, calibration, None, _SOURCE)
