"""A set as a folder of 16-bit TIFF files with ``lights.lp``, as RTI programs read it."""

from __future__ import annotations

import shlex
from pathlib import Path

import tifffile

from capture.sets.captured_set import CapturedSet
from capture.sets.light_list import write_light_list
from classify.durable_folder import durable_folder
from classify.errors import InputError

LIGHTS, _AMBIENT, _MASK, _METADATA = "lights.lp", "ambient.tif", "mask.tif", "metadata.json"


def write_light_folder(captured: CapturedSet, folder: Path) -> str:
    """Write the images with the pixel values of the camera, and the directions of the lights.

    Returns the options with which `ps4rig import` reads the same pixels back, quoted for a shell.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: exists and is not empty; choose another name")
    digits = len(str(len(captured.images) - 1))
    names = [f"light{index:0{digits}d}.tif" for index in range(len(captured.images))]
    pages = dict(zip(names, captured.images, strict=True))
    options = ["--lights", str(folder / LIGHTS)]
    if captured.ambient is not None:
        pages[_AMBIENT] = captured.ambient
        options += ["--ambient", str(folder / _AMBIENT)]
    if captured.mask is not None:
        pages[_MASK] = captured.mask.astype("u2") * 65535
        options += ["--mask", str(folder / _MASK)]
    with durable_folder(folder, [*pages, LIGHTS, _METADATA], LIGHTS) as temporary:
        for name, page in pages.items():
            tifffile.imwrite(temporary / name, page, photometric="minisblack")
        write_light_list(temporary / LIGHTS, captured.lighting, names)
        (temporary / _METADATA).write_text(
            captured.metadata.model_dump_json(indent=1), encoding="utf-8"
        )
    return shlex.join([*options, "--bits", str(captured.metadata.full_scale.bit_length())])
