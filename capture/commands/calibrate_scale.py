"""``ps4rig calibrate scale``: mm per pixel and distortion of the lens, from a checkerboard."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.commands import calibrate_flow as flow
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from capture.calibration.setting import Setting
    from capture.sets.captured_set import CapturedSet
    from classify.base.arrays import Array

# A simulated board cannot tilt; it is rotated by this angle from one placement to the next.
_ROTATION_STEP_DEG = 30.0


def scale(
    calibration: flow.CalibrationPath,
    checkerboard: Annotated[
        str,
        typer.Option(
            help="Inner corners of the board along its sides.",
            metavar="9x6",
        ),
    ],
    square_mm: Annotated[float, typer.Option(min=1e-3, max=1e4, help="Side of a square.")],
    rig: flow.RigToCalibrate = None,
    sources: Annotated[
        list[Path] | None,
        flow.from_files(
            "Photographs or sets of the board, instead of a rig. Repeat the option for "
            "more placements."
        ),
    ] = None,
    placements: Annotated[
        int,
        typer.Option(
            min=1,
            max=12,
            help="Placements of the board, one picture each. Four placements, one flat and three "
            "at different tilts, also give the focal length.",
        ),
    ] = 1,
    replace: flow.Replace = False,
    yes: flow.Yes = False,
    json: options.Json = False,
) -> None:
    """Measure the scale in mm per pixel, and the distortion of the lens, by a checkerboard.

    Lay the board flat where the part will be. Distortion is stored only if it moves some pixel by
    more than half a pixel; images are then corrected for it.
    """
    from capture.procedures.target_parts import scale_part

    corners = _corners(checkerboard)
    if (rig is None) == (not sources):
        raise InputError("give --rig RIG to capture the board, or --from IMG|SET of it")
    file = flow.calibration_at(calibration, sources or ())
    if rig is None and placements > 1:
        raise InputError("--placements is for a rig; give each picture of the board to --from")
    if rig is None:
        pictures, setting, source = _pictures_in_files(sources or ())
    else:
        pictures, setting, source = _pictures_at_rig(rig, square_mm, placements, yes)
    calibration_part = scale_part(pictures, corners, square_mm, setting, source)
    flow.keep_parts(calibration, file, [calibration_part], replace=replace, json=json)


def _corners(text: str) -> tuple[int, int]:
    numbers = re.fullmatch("([0-9]{1,3})[xX]([0-9]{1,3})", text)
    if numbers is None:
        raise InputError(f"--checkerboard {text}: give two numbers of inner corners, such as 9x6")
    return int(numbers[1]), int(numbers[2])


def _pictures_at_rig(
    rig: str, square_mm: float, placements: int, yes: bool
) -> tuple[list[Array], Setting, list[str]]:
    from capture.calibration.setting import Setting
    from rig import open_rig

    target = flow.Target(
        "a checkerboard",
        "checkerboard",
        square_mm,
        next_placement="tilt the board by 15 to 30 degrees, about another axis each time",
    )
    with open_rig(rig) as opened:
        rotations_deg = [_ROTATION_STEP_DEG * k for k in range(placements)]
        sets = flow.captured_targets(opened, target, rotations_deg, yes=yes)
        pictures = [_mean_light_image(captured) for captured in sets]
        return pictures, Setting.of_rig(opened), ["captured"]


def _pictures_in_files(sources: Sequence[Path]) -> tuple[list[Array], Setting, list[str]]:
    from capture.calibration.setting import Setting
    from capture.sets.captured_set import CapturedSet
    from capture.sets.photographs import read_photographs

    photographs, sets = flow.photographs_or_sets(sources)
    source = [path.name for path in (*photographs, *sets)]
    if photographs:
        # The position of a corner does not depend on gamma.
        stack = read_photographs(photographs, gamma="linear", bits=None, crop=None)
        shape = stack.planes[0].shape
        setting = Setting.of_photographs(shape, stack.bit_depth, stack.gamma)
        return [*stack.planes], setting, source
    captured_sets = [CapturedSet.load(path) for path in sets]
    sizes = {captured.images.shape[1:] for captured in captured_sets}
    if len(sizes) > 1:
        raise InputError("the sets of --from differ in size; give sets of one camera")
    pictures = [_mean_light_image(captured) for captured in captured_sets]
    return pictures, captured_sets[0].setting, source


def _mean_light_image(captured: CapturedSet) -> Array:
    """Mean of the light images of a set, which has the least noise and shadow."""
    mean: Array = captured.images.mean(axis=0, dtype="float32")
    return mean
