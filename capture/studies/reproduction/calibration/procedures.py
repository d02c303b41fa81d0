"""The calibration of a simulated rig, measured as the commands of ``ps4rig calibrate`` do."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from capture.acquisition.frame_series import (
    brightest_light,
    exposure_kept,
    frame_series,
    ladder_frames,
    ladder_ms,
)
from capture.calibration.camera_parts import Rung, dark_part, levels_of, response_parts
from capture.calibration.plate_parts import plate_parts
from capture.calibration.ps4cal import CalibrationFile, MeasuredPart
from capture.calibration.setting import Setting
from classify.calibration.calibration import Calibration
from classify.calibration.dark_frames import dark_of
from rig import Placement, Rig, Simulation, open_rig

from .rigs import Conditions, captured_targets

# As in capture/commands/calibrate/: frames in the dark, at each exposure of the ladder, and of each
# image of the sheet, which is turned by half a turn.
_DARK_FRAMES, _LADDER_FRAMES, _SHEET_FRAMES = 16, 4, 4
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
    frames = frame_series(rig, None, _DARK_FRAMES)
    lit = np.concatenate([frame_series(rig, light, 1) for light in range(len(rig.lighting))])
    found = dark_of(frames, _full_scale(rig), lit)
    return [dark_part(found, found.dark, Setting.of_rig(rig), _SOURCE)]


def _response(rig: Rig, simulation: Simulation, calibration: Calibration) -> list[MeasuredPart]:
    simulation.place(_SHEET[0])
    full_scale = _full_scale(rig)
    with exposure_kept(rig):
        light = brightest_light(rig)
        rungs = [
            Rung(exposure_ms, levels_of(frames, full_scale, calibration))
            for exposure_ms, frames in ladder_frames(
                rig, light, ladder_ms(rig, light), _LADDER_FRAMES
            )
        ]
    return response_parts(rungs, full_scale, calibration, Setting.of_rig(rig), _SOURCE)


def _plate(rig: Rig, _: Simulation, calibration: Calibration) -> list[MeasuredPart]:
    sets = list(captured_targets(rig, _SHEET, _SHEET_FRAMES))
    return plate_parts(sets, calibration, None, _SOURCE)


def _full_scale(rig: Rig) -> int:
    return (1 << rig.camera.info.bit_depth) - 1
