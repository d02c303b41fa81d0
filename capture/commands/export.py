"""The command ``ps4rig export``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.console import out, print_json, reported
from classify.errors import InputError

from . import options

if TYPE_CHECKING:
    from capture.batch.tasks import LoadedSet

_ARRAYS, _MESHES = ".npz", (".ply", ".stl")


@reported
def export(
    captured_set: Annotated[Path, typer.Argument(metavar="SET", help="A captured set.")],
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="NAME.npz with all arrays, NAME.ply or NAME.stl with the height as a mesh, or a "
            "folder for 16-bit TIFF files and lights.lp.",
        ),
    ],
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Write a captured set, or its height, for other programs."""
    from capture.batch.tasks import LoadedSet
    from capture.exchange.light_folder import write_light_folder
    from capture.exchange.numpy_file import write_numpy_file
    from capture.outputs import check_output
    from capture.sets.captured_set import CapturedSet

    suffix = output.suffix.lower()
    if suffix and suffix not in (_ARRAYS, *_MESHES):
        raise InputError(
            f"{output}: end the name in {_ARRAYS}, {' or '.join(_MESHES)}, or name a folder"
        )
    if suffix:
        check_output(output, suffix=output.suffix, inputs=[captured_set], force=force)
    said = {"set": str(captured_set), "output": str(output)}
    if suffix in _MESHES:
        said["unit"] = _write_mesh(LoadedSet.of(captured_set), output)
    elif suffix:
        write_numpy_file(CapturedSet.load(captured_set), output)
    else:
        said["import_options"] = write_light_folder(CapturedSet.load(captured_set), output)
    if json:
        print_json(said)
        return
    unit = f", lengths in {said['unit']}" if "unit" in said else ""
    out.print(f"{output}: written{unit}", soft_wrap=True)
    if "import_options" in said:
        out.print(f"back again: ps4rig import {said['import_options']} OUT.ome.tif", soft_wrap=True)


def _write_mesh(loaded: LoadedSet, output: Path) -> str:
    """Write the height of a set as a mesh; return the unit of its lengths."""
    from capture.exchange.mesh import write_ply, write_stl
    from classify import integrate_gradients

    surface = loaded.captured.solve(calibration=loaded.calibration)
    scale = None if loaded.calibration is None else loaded.calibration.scale
    per_px, unit = (1.0, "px, relative") if scale is None else (scale.mm_per_px, "mm")
    height = integrate_gradients(surface.p, surface.q)
    height *= per_px
    if output.suffix.lower() == ".ply":
        write_ply(output, height, surface.albedo, per_px, unit)
    else:
        write_stl(output, height, per_px, unit)
    return unit
