"""A set for other programs: a NumPy ``.npz``, or a folder of TIFF with ``lights.lp`` for RTI."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import tifffile

from capture.sets.captured_set import CapturedSet
from capture.sets.light_list import write_light_list
from capture.sets.photographs import EXPORTED_METADATA
from classify.base.durable_file import durable_file, durable_folder
from classify.base.errors import InputError

_LIGHTS, _AMBIENT, _MASK = "lights.lp", "ambient.tif", "mask.tif"


def write_light_folder(captured: CapturedSet, folder: Path) -> str:
    """Write the camera's pixel values and light directions.

    Returns the quoted options with which ``ps4rig import`` reads them back.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: exists and is not empty; choose another name")
    digits = len(str(len(captured.images) - 1))
    names = [f"light{index:0{digits}d}.tif" for index in range(len(captured.images))]
    pages = dict(zip(names, captured.images, strict=True))
    options = ["--lights", str(folder / _LIGHTS)]
    if captured.ambient is not None:
        pages[_AMBIENT] = captured.ambient
        options += ["--ambient", str(folder / _AMBIENT)]
    if captured.mask is not None:
        pages[_MASK] = captured.mask.astype("u2") * 65535
        options += ["--mask", str(folder / _MASK)]
    with durable_folder(folder, [*pages, _LIGHTS, EXPORTED_METADATA], _LIGHTS) as temporary:
        for name, page in pages.items():
            tifffile.imwrite(temporary / name, page, photometric="minisblack")
        write_light_list(temporary / _LIGHTS, captured.lighting, names)
        (temporary / EXPORTED_METADATA).write_text(
            captured.metadata.model_dump_json(indent=1), encoding="utf-8"
        )
    if captured.metadata.mm_per_px is not None:
        options += ["--mm-per-px", str(captured.metadata.mm_per_px)]
    return shlex.join([*options, "--bits", str(captured.metadata.full_scale.bit_count())])


def write_numpy_file(captured: CapturedSet, path: Path) -> None:
    """Write images, ambient image, mask, lights and metadata (JSON text) under their names."""
    lighting = captured.lighting
    arrays = {
        "images": captured.images,
        "ambient": captured.ambient,
        "mask": captured.mask,
        "directions": lighting.directions,
        "intensities": lighting.intensities,
        "positions_px": lighting.positions_px,
        "metadata": np.array(captured.metadata.model_dump_json()),
    }
    present = {name: array for name, array in arrays.items() if array is not None}
    with durable_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **present)
