"""``ps4rig calibrate dark`` and ``response``: the camera without light, its linearity and noise."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.commands import calibrate_flow as flow
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from capture.calibration.ps4cal import MeasuredPart
    from capture.sets.photographs import Gamma
    from classify import Calibration
    from rig import Rig


def dark(
    calibration: flow.CalibrationPath,
    rig: flow.RigToCalibrate = None,
    sources: Annotated[
        list[Path] | None,
        flow.from_files(
            "Photographs with the lens covered, instead of a rig; two or "
            "more. A captured set gives the ambient light. Repeat the option."
        ),
    ] = None,
    gamma: flow.PhotographGamma = None,
    bits: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=16,
            help="Depth of the data in photographs of 16 bits.",
            show_default="as in the set",
        ),
    ] = None,
    replace: flow.Replace = False,
    yes: flow.Yes = False,
    json: options.Json = False,
) -> None:
    """Measure the camera with its lens covered: offset, noise and hot pixels; then ambient light.

    The results hold for the exposure of the measurement. Run the command again at another exposure
    to extend them: they then hold from the shortest to the longest one.
    """
    if (rig is None) == (not sources):
        raise InputError("give --rig RIG, or --from IMG with photographs of the covered lens")
    file = flow.calibration_at(calibration, sources or ())
    if rig is None:
        part = _dark_part_from_photographs(sources or [], gamma, bits)
    else:
        from rig import open_rig

        if bits is not None or gamma is not None:
            raise InputError("--bits and --gamma are for photographs; leave them out with --rig")
        with open_rig(rig) as opened:
            part = _dark_part_from_rig(opened, yes)
    flow.keep_parts(calibration, file, [part], replace=replace, json=json)


def _dark_part_from_rig(rig: Rig, yes: bool) -> MeasuredPart:
    from capture.acquisition.frame_series import dark_of_rig, frame_series, require_free_running
    from capture.calibration.setting import Setting
    from capture.procedures.camera_parts import dark_part
    from classify.calibration.dark import with_ambient

    require_free_running(rig)
    simulation = rig.simulation
    placement = None if simulation is None else simulation.placement
    if simulation is not None and placement is not None:
        simulation.place(placement.model_copy(update={"surface": "lens_cap"}))
    elif not yes:
        flow.ask("cover the lens with its cap or with black foil, then press Enter")
    dark_frames = dark_of_rig(rig)
    dark = dark_frames.dark
    if simulation is not None and placement is not None:
        simulation.place(placement)
    elif not yes:
        flow.ask("uncover the lens, with the room's light as for captures, then press Enter")
    # With --yes nobody uncovers the lens of a real camera, and ambient light is not measured.
    if placement is not None or not yes:
        [ambient] = frame_series(rig, None, 1)  # None: all LEDs off
        dark = with_ambient(dark, ambient, dark.full_scale)
    return dark_part(dark_frames, dark, Setting.of_rig(rig), ("captured",))


def _dark_part_from_photographs(
    sources: list[Path], gamma: Gamma | None, bits: int | None
) -> MeasuredPart:
    import numpy as np

    from capture.calibration.setting import Setting
    from capture.procedures.camera_parts import dark_part
    from capture.sets.captured_set import CapturedSet
    from capture.sets.photographs import DNG
    from classify.calibration.dark import dark_of, with_ambient

    images, set_paths = flow.source_files(sources)
    if not images:
        raise InputError("--from names no photographs of the covered lens; give two or more")
    sets = [CapturedSet.load(path) for path in set_paths]
    if bits is None and sets and images[0].suffix.lower() != DNG:
        bits = sets[0].metadata.bit_depth
    photographs = flow.photographs_of(images, gamma, bits)
    if photographs.depth_guessed_from is not None:
        raise InputError(
            f"{images[0]}: 16 bits, and dark pixels do not show the depth of the data; give --bits "
            "N, or a captured set of the same camera with --from"
        )
    frames = np.stack(photographs.planes)
    dark_frames = dark_of(frames, photographs.full_scale)
    dark = dark_frames.dark
    for path, captured in zip(set_paths, sets, strict=True):
        if captured.ambient is None:
            raise InputError(f"{path}: has no ambient image; leave it out")
        dark = with_ambient(dark, captured.ambient, captured.metadata.full_scale)
    setting = Setting.of_photographs(frames.shape[1:], photographs.bit_depth, photographs.gamma)
    return dark_part(dark_frames, dark, setting, [path.name for path in (*images, *set_paths)])


_SHEET = flow.Target("a white matt sheet", surface="plate")


def response(
    calibration: flow.CalibrationPath,
    rig: flow.RigToCalibrate = None,
    sources: Annotated[
        list[Path] | None,
        flow.from_files(
            "Photographs or sets of one still scene at six exposures or more, instead of a rig. "
            "Repeat the option."
        ),
    ] = None,
    exposures_ms: Annotated[
        str | None,
        typer.Option(
            "--exposures-ms",
            help="Exposures of the photographs in their order.",
            show_default="as in their EXIF data",
            metavar="T,T,...",
        ),
    ] = None,
    gamma: flow.PhotographGamma = None,
    replace: flow.Replace = False,
    yes: flow.Yes = False,
    json: options.Json = False,
) -> None:
    """Measure linearity and noise of the camera by a ladder of exposures of a white sheet.

    A camera that is not linear gets the inverse of its curve. Neither the sheet nor the light of
    the room may change meanwhile. Two photographs or sets of each exposure show the noise too.
    """
    if (rig is None) == (not sources):
        raise InputError("give --rig RIG to capture a ladder of exposures, or --from IMG|SET of it")
    file = flow.calibration_at(calibration, sources or ())
    if rig is None:
        parts = _response_of_files(sources or [], exposures_ms, gamma, file.calibration)
    else:
        from rig import open_rig

        if exposures_ms is not None or gamma is not None:
            raise InputError("--exposures-ms and --gamma are for photographs; leave them out")
        with open_rig(rig) as opened:
            parts = _response_of_rig(opened, file.calibration, yes)
    flow.keep_parts(calibration, file, parts, replace=replace, json=json)


def _response_of_files(
    sources: list[Path], exposures_ms: str | None, gamma: Gamma | None, calibration: Calibration
) -> list[MeasuredPart]:
    from capture.procedures.camera_parts import (
        response_of_photographs,
        response_parts,
        rungs_of_sets,
    )
    from capture.sets.captured_set import CapturedSet

    photographs, sets = flow.photographs_or_sets(sources)
    names = [path.name for path in (*photographs, *sets)]
    if photographs:
        times_ms = _exposures_ms(photographs, exposures_ms)
        read = flow.photographs_of(photographs, gamma)
        return response_of_photographs(
            read, times_ms, calibration, names, are_marked=exposures_ms is None
        )
    if exposures_ms is not None or gamma is not None:
        raise InputError("--exposures-ms and --gamma are for photographs; sets state both")
    captured = [CapturedSet.load(path) for path in sets]
    rungs = rungs_of_sets(captured, calibration)
    return response_parts(rungs, calibration, captured[0].setting, names)


def _exposures_ms(photographs: list[Path], text: str | None) -> list[float]:
    from capture.base.names import typed_number
    from rig.image_file import read_image_file

    if text is None:
        exposures = [(path, read_image_file(path)[1].exposure_ms) for path in photographs]
        missing = next((path for path, exposure_ms in exposures if exposure_ms is None), None)
        if missing is not None:
            raise InputError(
                f"{missing}: its EXIF data state no exposure; give --exposures-ms with one for "
                "each photograph"
            )
        return [exposure_ms for _, exposure_ms in exposures if exposure_ms is not None]
    try:
        times_ms = [typed_number(time_ms) for time_ms in text.split(",")]
    except ValueError as error:
        raise InputError(f"--exposures-ms {text}: give numbers separated by commas") from error
    if len(times_ms) != len(photographs) or not all(0.0 < time_ms < 1e7 for time_ms in times_ms):
        raise InputError(
            f"--exposures-ms {text}: give a positive exposure for each of {len(photographs)} "
            "photographs"
        )
    return times_ms


def _response_of_rig(rig: Rig, calibration: Calibration, yes: bool) -> list[MeasuredPart]:
    from capture.acquisition.frame_series import require_free_running, rungs_of_rig
    from capture.calibration.setting import Setting
    from capture.procedures.camera_parts import response_parts

    require_free_running(rig)
    setting = Setting.of_rig(rig)
    flow.place_target(rig, _SHEET, yes=yes)
    rungs = rungs_of_rig(rig, calibration)
    return response_parts(rungs, calibration, setting, ("captured",))
