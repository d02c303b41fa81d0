"""The command ``ps4rig solve``."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.base.console import ItemProgress, out, print_json, progress, reported
from classify.base.errors import InputError
from classify.methods import METHODS, Method

from . import options

if TYPE_CHECKING:
    from capture.batch.tasks import SolvedSet
    from classify import Lighting

_RELIT = "135,45"
# Fall-off of the near LEDs in the table of faults of `tests.evidence.textures`; without --planar,
# textures under them are confused.
_PLAIN_FALL_OFF = 0.25


@reported
def solve(
    sets: options.Sets,
    output: Annotated[
        Path,
        typer.Option(
            "--out",
            help="Folder for the maps. With several sets each gets a subfolder of its name.",
            metavar="DIR",
        ),
    ],
    method: Annotated[
        Method | None,
        typer.Option(
            help=f"One of {', '.join(METHODS)}.",
            show_default="ps4_robust for four lights, else least_squares",
            metavar="METHOD",
        ),
    ] = None,
    planar: Annotated[
        bool,
        typer.Option(
            "--planar",
            help="The part is flat but for its texture: divide out the fall-off of near lights. "
            "This also takes away a tilt or bow of the part.",
        ),
    ] = False,
    calibration: options.CalibrationOfSet = None,
    raw: options.Raw = False,
    relight: Annotated[
        str | None,
        typer.Option(
            help="Light of the relit image in degrees.", show_default=_RELIT, metavar="TILT,SLANT"
        ),
    ] = None,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    json: options.Json = False,
) -> None:
    """Write the maps of captured sets: p, q, albedo, normals, relative height, shadows and more."""
    from capture.batch.runner import Batch
    from capture.batch.tasks import SolveTask, solve_set, warn_of_sets
    from capture.maps.surface_maps import RELIT_LIGHT
    from capture.maps.views import SHOWN_LIGHTS
    from capture.sets.archive import output_folders

    options.check_calibration(calibration, raw)
    light = RELIT_LIGHT if relight is None else _light(relight)
    folders = output_folders(sets, output)
    tasks = [SolveTask(path.absolute(), folder.absolute()) for path, folder in folders.items()]
    rows, warnings = [], []
    with Batch(workers, scheduler) as batch:
        task = partial(
            solve_set,
            method=method,
            light=light,
            planar=planar,
            calibration=None if calibration is None else calibration.absolute(),
            raw=raw,
        )
        share = ItemProgress()
        solving = batch.map(task, tasks, here=partial(task, on_progress=share))
        solved = progress(solving, len(tasks), "solve", share)
        for (path, folder), surface in zip(folders.items(), solved, strict=True):
            warnings.append((path, surface.warnings))
            if json:
                rows.append(_as_json(path, folder, surface))
            else:
                note = " (of a simulated set)" if surface.simulated else ""
                if surface.lights > SHOWN_LIGHTS:
                    note += f", the page shows {SHOWN_LIGHTS} of {surface.lights} light images"
                out.print(f"{folder}: {len(surface.files)} files{note}")
                out.print(
                    f"valid {surface.valid:.1%}, saturated {surface.saturated:.1%}, "
                    f"in shadow of a light {surface.shadowed:.1%} of the pixels"
                )
                for describe in (_residual_note, _levels_note, _fall_off_note):
                    if text := describe(surface):
                        out.print(text)
    warn_of_sets(warnings)
    if json:
        # The answer for one set that is given as a file is an object, not a list.
        print_json(rows if folders.get(sets[0]) != output else rows[0])


def _residual_note(surface: SolvedSet) -> str | None:
    if surface.calibration is None or surface.residual is None:
        return None
    raw = "" if surface.raw_residual is None else f", {surface.raw_residual:.2%} without it"
    return f"calibrated by {surface.calibration}: median residual {surface.residual:.2%}{raw}"


def _levels_note(surface: SolvedSet) -> str | None:
    levels = surface.led_levels
    if levels is None or max(levels) == min(levels):
        return None
    texts = ", ".join(f"{level:.3f}" for level in levels)
    return f"LED levels {texts} were found in the images and divided out: the set gives none"


def _fall_off_note(surface: SolvedSet) -> str | None:
    share = surface.fall_off
    if surface.planar and share is None:
        return "solved as a planar part, but too little of it is lit: no fall-off was divided out"
    if surface.planar:
        return (
            f"solved as a planar part: light falls off by {share:.0%} across it, which was divided "
            "out, with any tilt or bow of the part"
        )
    if share is None or share < _PLAIN_FALL_OFF:
        return None
    return f"if the part is flat, light falls off by {share:.0%} across it: use --planar"


def _light(angles: str) -> Lighting:
    from classify import Lighting

    degrees = options.degrees("--relight", angles, _RELIT)
    if len(degrees) != 2:
        raise InputError(f"--relight {angles}: give tilt and slant in degrees, such as {_RELIT}")
    return Lighting.from_angles(degrees[:1], degrees[1])


def _as_json(path: Path, folder: Path, surface: SolvedSet) -> dict[str, Any]:
    fields = asdict(surface)
    del fields["lights"], fields["warnings"]
    files = [str(folder / name) for name in surface.files]
    return {"set": str(path)} | fields | {"files": files}
