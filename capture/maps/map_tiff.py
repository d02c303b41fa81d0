"""A map as a TIFF file that tifffile and ImageJ open, with a description in JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tifffile

from capture.sets.ome_tiff import resolution
from classify.base.arrays import Array, FloatMap
from classify.base.errors import InputError
from rig.set_file import opened_tiff

_Description = dict[str, Any]


def write_values(
    path: Path, values: FloatMap, description: _Description, mm_per_px: float | None
) -> None:
    """Write (H, W) float32 values."""
    tifffile.imwrite(
        path, values, photometric="minisblack", metadata=None, description=json.dumps(description),
        **resolution(mm_per_px),
    )  # fmt: skip


def write_channels(
    path: Path,
    channels: FloatMap | npt.NDArray[np.uint8],
    names: tuple[str, ...],
    display_range: tuple[float, float],
    description: _Description,
    mm_per_px: float | None,
) -> None:
    """Write (C, H, W) or (H, W) as an ImageJ hyperstack, grey within `display_range`."""
    # A hyperstack, because ImageJ cannot open interleaved float32. With the unit "pixel", because
    # Bio-Formats takes micrometres for a missing one.
    per_unit, unit = (1.0, "pixel") if mm_per_px is None else (1.0 / mm_per_px, "mm")
    low, high = display_range
    tifffile.imwrite(
        path, channels, imagej=True, resolution=(per_unit, per_unit),
        metadata={
            "axes": "CYX"[-channels.ndim :], "mode": "grayscale", "min": low, "max": high,
            "unit": unit, "Labels": list(names), "Info": json.dumps(description),
        },
    )  # fmt: skip


def read_description(path: Path) -> _Description:
    """Read the description of a map that ps4rig wrote."""
    with opened_tiff(path) as tiff:
        return _description(tiff, path)


def read_map(path: Path) -> tuple[Array, _Description]:
    """Read a map, (H, W) or (C, H, W), and its description."""
    with opened_tiff(path) as tiff:
        description = _description(tiff, path)
        if tiff.series[0].nbytes > tiff.filehandle.size:
            raise InputError(f"{path}: declares more pixels than it holds; solve the set again")
        return tiff.asarray(), description


def _description(tiff: tifffile.TiffFile, path: Path) -> _Description:
    hyperstack = tiff.imagej_metadata
    text = tiff.pages.first.description if hyperstack is None else hyperstack.get("Info", "")
    try:
        description = json.loads(text)
    except (ValueError, RecursionError):
        description = None
    if not isinstance(description, dict) or "pixels_sha256" not in description:
        raise InputError(f"{path}: a TIFF, but not a map of ps4rig; ps4rig solve writes maps")
    return description
