"""Commands that make captured sets: capture, import."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from capture.base.console import complain, out, print_json, progress
from capture.base.errors import ImportCause
from capture.base.outputs import check_output
from classify.base.errors import InputError

from . import options

if TYPE_CHECKING:
    from capture.calibration.ps4cal import CalibrationFile
    from capture.sets.captured_set import CapturedSet
    from capture.sets.photographs import Crop
    from rig import Placement, Rig, RigConfig

_DEFAULT_TILTS = "0,90,180,270"


def capture(
    output: Annotated[Path, typer.Argument(metavar="OUT", help="Output file, NAME.ome.tif.")],
    rig: options.Rig = "rig.toml",
    label: options.Label = None,
    specimen: options.Specimen = None,
    operator: options.Operator = None,
    note: options.Note = None,
    orientation: options.Orientation = None,
    average: Annotated[int, typer.Option(min=1, help="Frames that each image averages.")] = 1,
    calibration: Annotated[Path | None, options.calibration_option("that of rig.toml")] = None,
    count: Annotated[
        int,
        typer.Option(
            min=1,
            max=9999,
            help="Number of sets, in numbered files after those that exist.",
        ),
    ] = 1,
    target: Annotated[
        bool,
        typer.Option(
            "--target",
            help="The part is a calibration target, such as a sphere: its shading is not checked.",
        ),
    ] = False,
    surface: options.Surface = None,
    rotate: Annotated[
        list[float] | None,
        typer.Option(
            help="Orientation of the surface, anticlockwise. Repeat the option for more sets.",
            rich_help_panel=options.SIMULATION,
            metavar="DEG",
        ),
    ] = None,
    slant: options.Slant = None,
    shift_px: options.ShiftPx = None,
    defect: options.Defects = None,
    seed: options.Seed = None,
    bits: options.Bits = None,
    size: options.Size = None,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Capture one set or several: the ambient image, then one image under each LED."""
    from capture.base.names import SET_SUFFIX
    from capture.calibration.lookup import read_calibration
    from capture.sets.description import described
    from rig import ConfigError, open_rig
    from rig.config.rig import config_of

    config = config_of(rig)
    calibration_file = None if calibration is None else read_calibration(calibration)
    recording = config.camera.recording
    recordings = [] if recording is None else [recording]
    orientations_deg: list[float] | list[None] = rotate or [None]
    paths = _output_paths(output, len(orientations_deg) * count, replace=force)
    for path in paths:
        check_output(path, suffix=SET_SUFFIX, inputs=recordings, force=force)
    simulation_options = (surface, rotate, slant, shift_px, defect, seed, bits, size)
    has_surface = config.is_simulated and recording is None
    if not has_surface and any(value is not None for value in simulation_options):
        raise ConfigError(
            f"{rig}: not a simulated rig; leave out the options under "
            f"'{options.SIMULATION}' of --help"
        )
    placement = {
        "surface": surface,
        "shift_px": shift_px,
        "defects": options.defects(defect),
        "seed": seed,
    }
    options.check_orientations("--orientation", orientation)
    # Check all configurations before the first capture.
    configs = [
        options.with_simulation(config, placement | {"rotate_deg": rotate_deg}, slant, bits, size)
        for rotate_deg in orientations_deg
    ]
    options.check_orientations("--rotate", *orientations_deg)
    for placed_config in configs if has_surface else ():
        _check_placement(placed_config, orientation)
    with open_rig(configs[0]) as opened:
        placements = [config.simulation.placement for config in configs]
        sets = _captured(opened, placements, count, label, average, calibration_file, target)
        saved = []
        for path, captured in zip(paths, progress(sets, len(paths), "capture"), strict=True):
            described(
                captured,
                specimen=specimen,
                operator=operator,
                note=note,
                orientation_deg=orientation,
            ).save(path)
            saved.append({"set": str(path), "simulated": captured.metadata.simulated})
            if not json:
                origin = " (simulated)" if captured.metadata.simulated else ""
                lights = f"{len(captured.images)} lights in {_frames_and_time(captured)}"
                out.print(f"{path}: {lights}{origin}")
    if json:
        print_json(saved)


def _check_placement(config: RigConfig, orientation_deg: float | None) -> None:
    """Refuse an orientation that the simulated part does not have; warn of defects outside."""
    camera, placement = config.camera, config.simulation.placement
    if orientation_deg is not None and (orientation_deg - placement.rotate_deg) % 360.0:
        raise InputError(
            f"--orientation {orientation_deg:g}: the simulated part is at "
            f"{placement.rotate_deg:g} degrees; give --rotate {orientation_deg:g} instead"
        )
    for defect in placement.defects_outside(camera.width_px, camera.height_px):
        complain(
            f"warning: {defect.kind} at {defect.x_px:g}, {defect.y_px:g}: outside the frame of "
            f"{camera.width_px} x {camera.height_px} px at {placement.rotate_deg:g} degrees"
        )


def _frames_and_time(captured: CapturedSet) -> str:
    """Number of frames of a set and its capture time, as text."""
    frames = [frame for image in captured.metadata.images for frame in image.frames]
    first = min(frames, key=lambda frame: frame.sequence)
    last = max(frames, key=lambda frame: frame.sequence)
    time_s = last.exposure_end_s - first.exposure_start_s
    return f"{last.sequence - first.sequence + 1} frames, {1e3 * time_s:.0f} ms"


def _captured(
    rig: Rig,
    placements: list[Placement],
    count: int,
    label: str | None,
    average: int,
    calibration: CalibrationFile | None,
    is_target: bool,
) -> Iterator[CapturedSet]:
    from capture.acquisition.attempts import capture_set
    from rig.scene.targets import TARGETS

    for placement in placements:
        # A replay has no placement. The present part need not be rendered again.
        if rig.simulation is not None and rig.simulation.placement not in (None, placement):
            rig.simulation.place(placement)
        placed = None if rig.simulation is None else rig.simulation.placement
        shows_target = is_target or (placed is not None and placed.surface in TARGETS)
        for _ in range(count):
            yield capture_set(
                rig, label, average=average, calibration=calibration, is_target=shows_target
            )


def _output_paths(output: Path, count: int, replace: bool) -> list[Path]:
    """Return `output` for one set, or `count` numbered file names.

    Numbers continue after the highest existing one, or with `replace` begin at 1.
    """
    from capture.base.names import SET_SUFFIX

    if count == 1:
        return [output]
    stem = output.name.removesuffix(SET_SUFFIX)
    last = 0
    if output.parent.is_dir() and not replace:
        pattern = re.compile(f"{re.escape(stem)}-([0-9]+){re.escape(SET_SUFFIX)}")
        matches = (pattern.fullmatch(path.name) for path in output.parent.iterdir())
        last = max((int(match[1]) for match in matches if match), default=0)
    numbers = range(last + 1, last + count + 1)
    digits = max(3, len(str(numbers[-1])))
    return [output.with_name(f"{stem}-{number:0{digits}d}{SET_SUFFIX}") for number in numbers]


def import_(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="IMG... OUT",
            help="Photographs, one for each light, then the output file, NAME.ome.tif. Photographs "
            "that the file of --lights names may be left out.",
        ),
    ],
    tilts: Annotated[
        str | None,
        typer.Option(
            help="Tilts of the lights in degrees, separated by commas.", show_default=_DEFAULT_TILTS
        ),
    ] = None,
    slant: Annotated[
        float | None, typer.Option(help="Slant of all lights in degrees from the camera's axis.")
    ] = None,
    lights: Annotated[
        Path | None, typer.Option(help="File of light vectors instead of tilts: .json or RTI .lp.")
    ] = None,
    gamma: Annotated[
        Literal["linear", "srgb"] | None,
        typer.Option(
            help="Coding of brightness.",
            show_default="as the files state, else linear; not for JPEG",
        ),
    ] = None,
    ambient: Annotated[Path | None, typer.Option(help="Photograph with all lights off.")] = None,
    bits: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=16,
            help="Depth of the data in files of 16 bits.",
            show_default="from the largest value",
        ),
    ] = None,
    mask: Annotated[
        Path | None, typer.Option(help="Image of the same frame, white where the part is.")
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option(
            help="Part of the photographs to keep: column and row of its top left pixel, width and "
            "height.",
            metavar="X,Y,W,H",
        ),
    ] = None,
    calibration: Annotated[Path | None, options.calibration_option("none")] = None,
    mm_per_px: Annotated[
        float | None, typer.Option(min=1e-6, max=1e3, help="Length of a pixel in mm, if known.")
    ] = None,
    accept: Annotated[
        list[ImportCause] | None,
        typer.Option(
            help="Import despite this cause of rejection. Repeat the option for more causes."
        ),
    ] = None,
    label: options.Label = None,
    specimen: options.Specimen = None,
    operator: options.Operator = None,
    note: options.Note = None,
    orientation: options.Orientation = None,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Make a captured set from photographs: PNG, JPEG, TIFF, TGA or DNG, 8 or 16 bit.

    Photographs that no surface under these lights explains are refused, see --accept.
    """
    from capture.base.names import SET_SUFFIX
    from capture.calibration.lookup import read_calibration
    from capture.sets.description import described
    from capture.sets.light_list import load_light_list
    from capture.sets.photographs import import_images
    from classify import Lighting

    options.check_orientations("--orientation", orientation)
    *images, output = paths
    inputs = [path for path in (ambient, mask) if path is not None]
    warnings: Sequence[str] = ()
    if lights is not None:
        if slant is not None or tilts is not None:
            raise InputError("--lights gives the directions; leave out --slant and --tilts")
        light_list = load_light_list(lights, unknown_keys=ImportCause.LIGHT_KEYS in (accept or ()))
        warnings = light_list.warnings
        inputs += light_list.inputs
        images = images or light_list.image_paths()
        if not images:
            raise InputError(f"{lights}: gives no image names; name the images themselves")
        lighting = light_list.lighting_for(images)
    else:
        if slant is None:
            raise InputError("give --slant DEG of the lights, or --lights FILE")
        text = _DEFAULT_TILTS if tilts is None else tilts
        tilts_deg = options.degrees("--tilts", text, _DEFAULT_TILTS)
        lighting = Lighting.from_angles(tilts_deg, slant)
    check_output(output, suffix=SET_SUFFIX, inputs=[*images, *inputs], force=force)
    calibration_file = None if calibration is None else read_calibration(calibration)
    has_scale = calibration_file is not None and calibration_file.calibration.scale is not None
    if has_scale and mm_per_px is not None:
        raise InputError(f"--mm-per-px: {calibration} has a scale; leave one of the two out")
    captured = import_images(
        images, lighting, gamma=gamma, ambient=ambient, label=label, bits=bits, mask=mask,
        crop=None if crop is None else _crop(crop), accept=accept or (), warnings=warnings,
        calibration=None if calibration_file is None else calibration_file.calibration,
    )  # fmt: skip
    captured = described(
        captured, specimen=specimen, operator=operator, note=note, orientation_deg=orientation
    )
    if mm_per_px is not None:
        metadata = captured.metadata.model_copy(update={"mm_per_px": mm_per_px})
        captured = replace(captured, metadata=metadata)
    if calibration_file is not None:
        captured = captured.with_calibration(calibration_file)
    captured.save(output)
    metadata = captured.metadata
    for warning in metadata.warnings:
        complain(f"warning: {output}: {warning}")
    if json:
        print_json(
            {
                "set": str(output),
                "lights": len(images),
                "bits": metadata.bit_depth,
                "gamma": metadata.gamma,
                "gamma_source": metadata.gamma_source,
                "warnings": metadata.warnings,
            }
        )
    else:
        out.print(
            f"{output}: {len(images)} lights, response {metadata.gamma} ({metadata.gamma_source})"
        )


def _crop(text: str) -> Crop:
    try:
        x, y, width, height = map(int, text.split(","))
    except ValueError:
        raise InputError(f"--crop {text}: give four whole numbers X,Y,W,H in px") from None
    return x, y, width, height
