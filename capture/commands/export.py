"""The command ``ps4rig export``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import out, print_json, reported
from classify.base.errors import InputError

from . import options

if TYPE_CHECKING:
    from capture.sets.loaded_set import LoadedSet

_ARRAYS, _PLY, _STL, _X3P, _SUR = ".npz", ".ply", ".stl", ".x3p", ".sur"
_HEIGHTS = (_PLY, _STL, _X3P, _SUR)
FORMATS = {
    _ARRAYS: "all arrays",
    _PLY: "the height and the albedo as a mesh",
    _STL: "the height as a mesh",
    _X3P: "the height for programs that measure roughness; needs a calibrated scale",
    _SUR: "the same, for MountainsMap and Gwyddion",
}
FOLDER = "16-bit TIFF files and lights.lp, or the maps"


@reported
def export(
    captured_set: Annotated[Path, typer.Argument(metavar="SET", help="A captured set.")],
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="; ".join(f"NAME{suffix}: {content}" for suffix, content in FORMATS.items())
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
    from capture.maps.set_files import write_light_folder, write_numpy_file
    from capture.sets.captured_set import CapturedSet
    from capture.sets.loaded_set import LoadedSet, named

    suffix = output.suffix.lower()
    if suffix and (maps or suffix not in FORMATS):
        *some, last = FORMATS
        wrong = "--maps writes a folder; leave out the end of the name"
        if not maps:
            wrong = f"end the name in {', '.join(some)} or {last}, or name a folder"
        raise InputError(f"{output}: {wrong}")
    options.check_calibration(calibration, raw)
    if not maps and suffix not in _HEIGHTS and (raw or calibration is not None):
        raise InputError(f"{output}: is not solved; leave out --calibration and --raw")
    if suffix:
        check_output(output, suffix=output.suffix, inputs=[captured_set], force=force)
    answer: dict[str, str | tuple[str, ...]] = {"set": str(captured_set), "output": str(output)}
    if maps:
        task = SolveTask(captured_set, output)
        answer["files"] = solve_set(task, None, calibration=calibration, raw=raw).files
    elif suffix in _HEIGHTS:
        loaded = LoadedSet.of(captured_set, calibration, raw=raw)
        with named(captured_set):
            answer["unit"] = _write_height(loaded, output)
    elif suffix:
        write_numpy_file(CapturedSet.load(captured_set), output)
    else:
        answer["import_options"] = write_light_folder(CapturedSet.load(captured_set), output)
    if json:
        print_json(answer)
        return
    unit = f", lengths in {answer['unit']}" if "unit" in answer else ""
    out.print(f"{output}: written{unit}")
    if options_back := answer.get("import_options"):
        out.print(f"back again: ps4rig import {options_back} OUT.ome.tif")


def _write_height(loaded: LoadedSet, output: Path) -> str:
    """Write the height of a set as a measured surface or a mesh; return the unit of its lengths."""
    from capture.maps.digital_surf import write_sur
    from capture.maps.height_map import HeightMap, solved_height
    from capture.maps.mesh import write_ply, write_stl
    from capture.maps.x3p import write_x3p

    suffix = output.suffix.lower()
    if suffix == _X3P:
        write_x3p(output, HeightMap.of(loaded))
        return "m"
    if suffix == _SUR:
        write_sur(output, HeightMap.of(loaded))
        return "um"
    surface, height = solved_height(loaded)
    mm_per_px = None if loaded.calibration is None else loaded.calibration.mm_per_px
    per_px, unit = (1.0, "px, relative") if mm_per_px is None else (mm_per_px, "mm")
    height *= per_px
    if suffix == _PLY:
        write_ply(output, height, surface.albedo, per_px, unit)
    else:
        write_stl(output, height, per_px, unit)
    return unit
