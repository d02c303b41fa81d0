"""Commands that compute files from sets: solve, export."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.base.console import complain, out, print_json, progress_bar
from capture.commands import options
from classify.base.errors import InputError
from classify.methods import METHODS, Method

if TYPE_CHECKING:
    from capture.batch.tasks import SolvedSet
    from capture.sets.captured_set import LoadedSet
    from classify import Lighting

_RELIT = "135,45"
# Fall-off of the light over the part from which --planar is recommended. Under LEDs this near,
# textures are confused without it, as the table of faults of `tests.evidence.textures` shows.
_LARGE_FALL_OFF = 0.25


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
            "--method",
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
    from capture.maps.views import RELIT_LIGHT, SHOWN_LIGHTS
    from capture.sets.archive import output_folders

    options.check_calibration(calibration, raw)
    light = RELIT_LIGHT if relight is None else _light(relight)
    folders = output_folders(sets, output)
    tasks = [SolveTask(path.absolute(), folder.absolute()) for path, folder in folders.items()]
    rows: list[dict[str, Any]] = []
    warnings: list[tuple[Path, tuple[str, ...]]] = []
    with Batch(workers, scheduler) as batch, progress_bar(len(tasks), "solve") as show:
        task = partial(
            solve_set,
            method=method,
            light=light,
            planar=planar,
            calibration=None if calibration is None else calibration.absolute(),
            raw=raw,
        )

        def show_share(share: float) -> None:
            show(len(warnings) + share)  # a set that is solved has its warnings

        solved = batch.map(task, tasks, local_function=partial(task, on_progress=show_share))
        for (path, folder), surface in zip(folders.items(), solved, strict=True):
            warnings.append((path, surface.warnings))
            show(len(warnings))
            if json:
                rows.append(_as_json(path, folder, surface))
            else:
                note = " (of a simulated set)" if surface.simulated else ""
                if surface.lights > SHOWN_LIGHTS:
                    note += f", the page shows {SHOWN_LIGHTS} of {surface.lights} light images"
                out.print(f"{folder}: {len(surface.files)} files{note}")
                out.print(
                    f"of the pixels {surface.valid:.1%} are valid, {surface.saturated:.1%} "
                    f"saturated under some light, {surface.shadowed:.1%} in shadow of some light"
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
    texts = [f"{level:.3f}" for level in surface.led_levels or ()]
    if len({*texts}) < 2:
        return None
    listed = ", ".join(texts)
    return f"LED levels {listed} were found in the images and divided out: the set gives none"


def _fall_off_note(surface: SolvedSet) -> str | None:
    fall_off = surface.fall_off
    if surface.planar and fall_off is None:
        return "solved as a planar part, but too little of it is lit: no fall-off was divided out"
    if surface.planar:
        return (
            f"solved as a planar part: light falls off by {fall_off:.0%} across it, which was "
            "divided out, with any tilt or bow of the part"
        )
    if fall_off is None or fall_off < _LARGE_FALL_OFF:
        return None
    return f"if the part is flat, light falls off by {fall_off:.0%} across it: use --planar"


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


@dataclass(frozen=True)
class _ExportFormat:
    """A file format of `export`.

    `write` returns the unit of the lengths in the file. A format that is not `solved` gets a set
    without its calibration.
    """

    content: str
    write: Callable[[LoadedSet, Path], str | None]
    solved: bool = True


def _write_npz(loaded: LoadedSet, path: Path) -> None:
    from capture.maps.exports import write_numpy_file

    write_numpy_file(loaded.captured, path)


def _write_ply(loaded: LoadedSet, path: Path) -> str:
    from capture.maps.exports import scaled_height, write_ply

    surface, height, per_px, unit = scaled_height(loaded)
    write_ply(path, height, surface.albedo, per_px, unit)
    return unit


def _write_stl(loaded: LoadedSet, path: Path) -> str:
    from capture.maps.exports import scaled_height, write_stl

    _, height, per_px, unit = scaled_height(loaded)
    write_stl(path, height, per_px, unit)
    return unit


def _write_x3p(loaded: LoadedSet, path: Path) -> str:
    from capture.maps.exports import HeightMap, write_x3p

    write_x3p(path, HeightMap.of(loaded))
    return "m"


def _write_sur(loaded: LoadedSet, path: Path) -> str:
    from capture.maps.exports import HeightMap, write_sur

    write_sur(path, HeightMap.of(loaded))
    return "um"


# By the end of the name; a new format is a writer and a row.
FORMATS = {
    ".npz": _ExportFormat("all arrays", _write_npz, solved=False),
    ".ply": _ExportFormat("the height and the albedo as a mesh", _write_ply),
    ".stl": _ExportFormat("the height as a mesh", _write_stl),
    ".x3p": _ExportFormat(
        "the height for programs that measure roughness; needs a scale", _write_x3p
    ),
    ".sur": _ExportFormat("the same, for MountainsMap and Gwyddion", _write_sur),
}
FOLDER = "16-bit TIFF files and lights.lp, or the maps"


def export(
    captured_set: Annotated[Path, typer.Argument(metavar="SET", help="A captured set.")],
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="; ".join(f"NAME{suffix}: {form.content}" for suffix, form in FORMATS.items())
            + f"; or a folder: {FOLDER}.",
        ),
    ],
    maps: Annotated[
        bool, typer.Option("--maps", help="Write the maps to the folder, as ps4rig solve does.")
    ] = False,
    calibration: options.CalibrationOfSet = None,
    raw: options.Raw = False,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Write a captured set, or its height, for other programs."""
    from capture.base.outputs import check_output
    from capture.batch.tasks import SolveTask, solve_set
    from capture.maps.exports import write_light_folder
    from capture.sets.captured_set import LoadedSet, naming_file

    suffix = output.suffix.lower()
    form = FORMATS.get(suffix)
    if suffix and (maps or form is None):
        *suffixes, last_suffix = FORMATS
        advice = "--maps writes a folder; leave out the end of the name"
        if not maps:
            advice = f"end the name in {', '.join(suffixes)} or {last_suffix}, or name a folder"
        raise InputError(f"{output}: {advice}")
    options.check_calibration(calibration, raw)
    is_solved = maps or (form is not None and form.solved)
    if not is_solved and (raw or calibration is not None):
        raise InputError(f"{output}: is not solved; leave out --calibration and --raw")
    answer: dict[str, str | tuple[str, ...]] = {"set": str(captured_set), "output": str(output)}
    if maps:
        task = SolveTask(captured_set, output)
        answer["files"] = solve_set(task, None, calibration=calibration, raw=raw).files
    else:
        if form is not None:
            check_output(output, suffix=output.suffix, inputs=[captured_set], force=force)
        loaded = LoadedSet.of(captured_set, calibration, raw=raw or not is_solved)
        if not is_solved and loaded.captured.metadata.calibration_ids:
            complain(
                f"warning: {output}: lights and pixel values are not corrected by the calibration "
                "of the set"
            )
        if form is None:
            answer["import_options"] = write_light_folder(loaded.captured, output)
        else:
            with naming_file(captured_set):
                unit = form.write(loaded, output)
            answer |= {} if unit is None else {"unit": unit}
    if json:
        print_json(answer)
        return
    lengths = f", lengths in {answer['unit']}" if "unit" in answer else ""
    out.print(f"{output}: written{lengths}")
    if import_options := answer.get("import_options"):
        out.print(f"back again: ps4rig import {import_options} OUT.ome.tif")
