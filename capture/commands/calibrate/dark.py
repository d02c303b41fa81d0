"""``ps4rig calibrate dark``: the camera without light."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import reported
from capture.commands import options
from classify.base.errors import InputError

from . import flow

if TYPE_CHECKING:
    from capture.calibration.ps4cal import MeasuredPart
    from capture.sets.photographs import Gamma
    from rig import Rig


@reported
def dark(
    calibration: flow.CalibrationPath,
    rig: flow.RigToCalibrate = None,
    sources: Annotated[
        list[Path] | None,
        flow.from_files(
            "Photograph with the lens covered, instead of a rig, or a folder of them; two or "
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

    They hold for the exposure at which they were measured. Another exposure is added; then they
    hold between the shortest and the longest one.
    """
    if (rig is None) == (not sources):
        raise InputError("give --rig RIG, or --from IMG with photographs of the covered lens")
    file = flow.calibration_at(calibration, sources or ())
    if rig is None:
        part = _of_photographs(sources or [], gamma, bits)
    else:
        from rig import open_rig

        if bits is not None or gamma is not None:
            raise InputError("--bits and --gamma are for photographs; leave them out with --rig")
        with open_rig(rig) as opened:
            part = _of_rig(opened, yes)
    flow.keep_parts(calibration, file, [part], replace=replace, json=json)


def _of_rig(rig: Rig, yes: bool) -> MeasuredPart:
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
    measured = dark_of_rig(rig)
    dark = measured.dark
    if simulation is not None and placement is not None:
        simulation.place(placement)
    elif not yes:
        flow.ask("uncover the lens, with the room's light as for captures, then press Enter")
    # With --yes nobody uncovers the lens of a real camera, and ambient light is not measured.
    if placement is not None or not yes:
        dark = with_ambient(dark, frame_series(rig, None, 1)[0], dark.full_scale)
    return dark_part(measured, dark, Setting.of_rig(rig), ("captured",))


def _of_photographs(sources: list[Path], gamma: Gamma | None, bits: int | None) -> MeasuredPart:
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
    if photographs.largest is not None:
        raise InputError(
            f"{images[0]}: 16 bits, and dark pixels do not show the depth of the data; give --bits "
            "N, or a captured set of the same camera with --from"
        )
    frames = np.stack(photographs.planes)
    measured = dark_of(frames, photographs.full_scale)
    dark = measured.dark
    for path, captured in zip(set_paths, sets, strict=True):
        if captured.ambient is None:
            raise InputError(f"{path}: has no ambient image; leave it out")
        dark = with_ambient(dark, captured.ambient, captured.metadata.full_scale)
    setting = Setting.of_photographs(frames.shape[1:], photographs.bit_depth, photographs.gamma)
    return dark_part(measured, dark, setting, [path.name for path in (*images, *set_paths)])
