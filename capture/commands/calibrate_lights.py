"""``ps4rig calibrate plate`` and ``lights``: flat field and lights from a sheet or a sphere."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from capture.base.console import complain, out
from capture.commands import calibrate_flow as flow
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from capture.calibration.ps4cal import CalibrationFile
    from capture.calibration.setting import PartName, Setting
    from capture.sets.captured_set import CapturedSet
    from classify.calibration.spheres import SphereImages
    from rig import Rig

_SHEET = flow.Target(
    "a white matt sheet", "plate", next_placement="rotate the sheet by 180 degrees"
)
# Two placements 180 degrees apart cancel a tilt of the sheet and a gradient of its reflectance.
_ROTATIONS_DEG = (0.0, 180.0)
# Frames averaged in each image. They leave a quarter of the noise, so that LED positions can be
# fitted to small frames too.
_FRAMES = 16


def plate(
    calibration: flow.CalibrationPath,
    rig: flow.RigToCalibrate = None,
    sources: Annotated[
        list[Path] | None,
        flow.from_files(
            "Sets of the target instead of a rig. Repeat the option for more placements.",
            metavar="SET",
        ),
    ] = None,
    mask: Annotated[
        Path | None,
        typer.Option(
            help="Image that is white where the sheet is, or a part is flat; with --from."
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
    from capture.procedures.plate_parts import near_lights_are_refuted, plate_parts
    from capture.sets.archive import find_sets
    from capture.sets.captured_set import CapturedSet
    from capture.sets.photographs import read_mask
    from rig import open_rig

    if mask is not None and rig is not None:
        raise InputError("--mask is for the sets of --from; let the sheet fill the frame of a rig")
    inputs = [*(sources or ()), *([] if mask is None else [mask])]
    file = flow.calibration_at(calibration, inputs)
    if (rig is None) == (not sources):
        raise InputError("give --rig RIG to capture the target, or --from SET with sets of it")
    if rig is not None:
        with open_rig(rig) as opened:
            sets = list(flow.captured_targets(opened, _SHEET, _ROTATIONS_DEG, _FRAMES, yes=yes))
        source = ["captured"]
    else:
        paths = find_sets(sources or ())
        sets, source = [CapturedSet.load(path) for path in paths], [path.name for path in paths]
    rows, columns = sets[0].images.shape[1:]
    area = None if mask is None else read_mask(mask, (rows, columns), None)
    parts = plate_parts(sets, file.calibration, area, source)
    dropped: tuple[PartName, ...] = ()
    if replace and near_lights_are_refuted(file.calibration, parts):
        complain(
            f"warning: {calibration}: the sheet shows no LED positions; earlier ones are dropped"
        )
        dropped = ("lights",)
    flow.keep_parts(calibration, file, parts, replace=replace, json=json, dropped=dropped)


# Places of the sphere on a simulated rig, relative to the middle, as fractions of the shorter side
# of the frame. A sphere of 0.6 of that side stays inside the frame. The places are far enough apart
# for the position of an LED to be found from the rays to it.
_SPHERE_PLACES = ((0.0, 0.0), (0.18, 0.0), (-0.18, 0.0), (0.0, 0.18), (0.0, -0.18))


def lights(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="[IMG...] CAL",
            help="Further photographs, as after --from, and the calibration file, NAME.ps4cal. One "
            "that exists gets the lights added or replaced.",
        ),
    ],
    sphere: Annotated[
        Literal["mirror", "matte"],
        typer.Option(help="A polished ball, or a white matt one."),
    ],
    rig: flow.RigToCalibrate = None,
    sources: Annotated[
        list[Path] | None,
        flow.from_files(
            "Photographs of the sphere, one per light, or sets of it, instead of a rig. "
            "Photographs of further placements follow, in the same order of lights.",
            metavar="IMG...|SET",
        ),
    ] = None,
    mask: Annotated[
        list[Path] | None,
        typer.Option(
            help="Image of the same frame, white on the sphere; one per placement.", metavar="IMG"
        ),
    ] = None,
    count: Annotated[
        int | None,
        typer.Option(
            "--lights",
            min=1,
            max=255,
            help="Number of lights; there are as many photographs for each placement.",
            show_default="the number of photographs",
            metavar="N",
        ),
    ] = None,
    gamma: flow.PhotographGamma = None,
    diameter_mm: Annotated[
        float | None,
        typer.Option(min=1e-3, max=1e4, help="Diameter of the sphere; gives the scale too."),
    ] = None,
    placements: Annotated[
        int,
        typer.Option(
            min=1,
            max=len(_SPHERE_PLACES),
            help="Places of the sphere that a rig captures. Three give positions of near lights.",
        ),
    ] = 1,
    list_file: Annotated[
        Path | None,
        typer.Option(
            "--list",
            help="Write the directions to this file too, for import --lights: .lp or .json.",
            metavar="FILE",
        ),
    ] = None,
    force: options.Force = False,
    replace: flow.Replace = False,
    yes: flow.Yes = False,
    json: options.Json = False,
) -> None:
    """Measure the directions of the lights by a mirror sphere or a matt one below the camera.

    The sphere is found in the images, or given by --mask. One image per light gives directions;
    several placements of the sphere give the positions of near lights.
    """
    from capture.base.outputs import check_output
    from capture.calibration.setting import Setting
    from capture.procedures.target_parts import images_of_sets, sphere_parts
    from capture.sets.light_list import require_light_list_name, write_light_list
    from rig import open_rig

    calibration, photographs = _calibration_and_photographs(paths, sources, mask)
    if (rig is None) == (not photographs):
        raise InputError("give --rig RIG to capture the sphere, or --from IMG... or SET with it")
    file = flow.calibration_at(calibration, photographs)
    if list_file is not None:
        require_light_list_name(list_file)
        check_output(list_file, suffix=list_file.suffix, inputs=photographs, force=force)
    if rig is None and placements > 1:
        raise InputError("--placements is for a rig; photographs state theirs by --lights")
    if rig is not None:
        if mask or count is not None or gamma is not None:
            raise InputError("--mask, --lights and --gamma are for photographs; leave them out")
        target = flow.Target(
            f"a {sphere} sphere",
            f"{sphere}_sphere",
            diameter_mm,
            next_placement="move the sphere to another place in the frame",
        )
        with open_rig(rig) as opened:
            sets = list(_captured(opened, target, placements, yes))
            setting = Setting.of_rig(opened)
        spheres, source = images_of_sets(sets, file), ["captured"]
        image_names = [f"light{k}.tif" for k in range(len(sets[0].images))]
    else:
        spheres, setting, image_names = _images_of_files(
            photographs, mask or (), count, gamma, sphere, file
        )
        source = [path.name for path in photographs]
    parts = sphere_parts(spheres, sphere, file, setting, source, diameter_mm)
    merged = flow.keep_parts(calibration, file, parts, replace=replace, json=json)
    estimate = merged.calibration.lights
    assert estimate is not None
    if list_file is not None:
        write_light_list(list_file, estimate.lighting, image_names)
    if not json:
        for name, tilt_deg, slant_deg, error_deg in zip(
            image_names,
            estimate.lighting.tilts_deg.round(1) % 360.0,
            estimate.lighting.slants_deg,
            estimate.direction_errors_deg,
            strict=True,
        ):
            out.print(
                f"  {name}: tilt {tilt_deg:.1f}, slant {slant_deg:.1f} degrees, known to "
                f"{error_deg:.2g} degrees"
            )


def _calibration_and_photographs(
    paths: Sequence[Path], sources: Sequence[Path] | None, masks: Sequence[Path] | None
) -> tuple[Path, list[Path]]:
    """Separate the calibration file from the photographs, and leave out the masks.

    The shell expands ``--from photo*.png``: all photographs but the first become arguments.
    """
    from capture.calibration.ps4cal import SUFFIX

    files = [path for path in paths if path.suffix == SUFFIX]
    if len(files) != 1:
        raise InputError(f"{len(files)} files NAME{SUFFIX}; give the one to write the lights to")
    mask_paths = {path.resolve() for path in masks or ()}
    photographs = [
        path
        for path in (*(sources or ()), *(path for path in paths if path.suffix != SUFFIX))
        if path.resolve() not in mask_paths
    ]
    return files[0], photographs


def _images_of_files(
    sources: list[Path],
    masks: Sequence[Path],
    count: int | None,
    gamma: Literal["linear", "srgb"] | None,
    sphere: Literal["mirror", "matte"],
    file: CalibrationFile,
) -> tuple[list[SphereImages], Setting, list[str]]:
    """Read images of the sphere, their setting, and a name per light for a light list."""
    from capture.procedures.target_parts import images_of_photographs, images_of_sets
    from capture.sets.captured_set import CapturedSet

    photographs, sets = flow.photographs_or_sets(sources)
    if photographs:
        # A mirror sphere needs no gamma: the position of its highlight does not depend on it.
        coding = gamma or ("linear" if sphere == "mirror" else None)
        images = flow.photographs_of(photographs, coding)
        spheres, setting = images_of_photographs(images, masks, count, file)
        first_placement = [path.absolute() for path in photographs[: len(spheres[0].images)]]
        folder = os.path.commonpath([path.parent for path in first_placement])
        return spheres, setting, [path.relative_to(folder).as_posix() for path in first_placement]
    if masks or count is not None or gamma is not None:
        raise InputError("--mask, --lights and --gamma are for photographs; sets state them")
    captured = [CapturedSet.load(path) for path in sets]
    names = [f"light{k}.tif" for k in range(len(captured[0].images))]
    return images_of_sets(captured, file), captured[0].setting, names


def _captured(rig: Rig, target: flow.Target, placements: int, yes: bool) -> Iterator[CapturedSet]:
    from capture.acquisition.attempts import capture_set

    side_px = min(rig.camera.info.width_px, rig.camera.info.height_px)
    for number, (right, up) in enumerate(_SPHERE_PLACES[:placements]):
        shift_px = (right * side_px, up * side_px)
        flow.place_target(rig, target, shift_px=shift_px, again=number > 0, yes=yes)
        yield capture_set(rig, is_target=True)
