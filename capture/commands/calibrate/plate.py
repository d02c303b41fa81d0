"""``ps4rig calibrate plate``: flat field and LED positions from a white sheet."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import complain, reported
from capture.commands import options
from classify.base.errors import InputError

from . import flow

if TYPE_CHECKING:
    from capture.calibration.parts import PartName

_SHEET = flow.Target(
    "a white matt sheet", "plate", next_placement="rotate the sheet by 180 degrees"
)
# Two placements half a turn apart cancel a tilt of the sheet and a gradient of its reflectance.
_ROTATIONS_DEG = (0.0, 180.0)
# Frames averaged in each image: with a quarter of the noise, small frames show LED positions too.
_FRAMES = 16


@reported
def plate(
    calibration: flow.CalibrationPath,
    rig: flow.RigToCalibrate = None,
    sources: flow.FromSets = None,
    mask: Annotated[
        Path | None,
        typer.Option(
            help="Image of the same frame, white where the sheet is, or where a part is flat; with "
            "--from."
        ),
    ] = None,
    replace: flow.Replace = False,
    yes: flow.Yes = False,
    json: options.Json = False,
) -> None:
    """Measure how bright each light is over the frame, and where the LEDs stand, by a white sheet.

    The sheet is white and matt, fills the frame and lies flat. It is captured twice, the second
    time rotated by 180 degrees. Flat areas of a part serve as well, see --mask.
    """
    if mask is not None and rig is not None:
        raise InputError("--mask is for the sets of --from; let the sheet fill the frame of a rig")
    inputs = [*(sources or ()), *([] if mask is None else [mask])]
    file = flow.calibration_at(calibration, inputs)
    sets, source = flow.target_sets(
        rig, sources, _SHEET, rotations_deg=_ROTATIONS_DEG, average=_FRAMES, yes=yes
    )
    from capture.procedures.plate_parts import near_lights_are_refuted, plate_parts
    from capture.sets.photographs import read_mask

    rows, columns = sets[0].images.shape[1:]
    area = None if mask is None else read_mask(mask, (rows, columns), None)
    parts = plate_parts(sets, file.calibration, area, source)
    dropped: tuple[PartName, ...] = ()
    if replace and near_lights_are_refuted(file.calibration, parts):
        complain(f"warning: {calibration}: the positions of lights measured before are dropped")
        dropped = ("lights",)
    flow.keep_parts(calibration, file, parts, replace=replace, json=json, dropped=dropped)
