"""A map as a TIFF file that tifffile and ImageJ open, with a description in JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tifffile

from capture.sets.ome_tiff import resolution

Description = dict[str, Any]


def write_values(
    path: Path, values: npt.NDArray[np.float32], about: Description, mm_per_px: float | None
) -> None:
    """Write (H, W) float32 values; `about` is the description of the TIFF."""
    tifffile.imwrite(
        path, values, photometric="minisblack", metadata=None, description=json.dumps(about),
        **resolution(mm_per_px),
    )  # fmt: skip


def write_channels(
    path: Path,
    channels: npt.NDArray[np.float32] | npt.NDArray[np.uint8],
    names: tuple[str, ...],
    limits: tuple[float, float],
    about: Description,
    mm_per_px: float | None,
) -> None:
    """Write (C, H, W) channels, or one (H, W) channel, as an ImageJ hyperstack.

    ImageJ opens no TIFF of interleaved float32. It shows a hyperstack as grey between `limits`,
    with the names of its channels, and `about` as its info, since the description of such a file
    holds ImageJ's own settings.
    """
    scale: dict[str, Any] = {}
    if mm_per_px is not None:
        scale = {"resolution": (1.0 / mm_per_px, 1.0 / mm_per_px)}
    low, high = limits
    tifffile.imwrite(
        path, channels, imagej=True, **scale,
        metadata={
            "axes": "CYX"[-channels.ndim :], "mode": "grayscale", "min": low, "max": high,
            "Labels": list(names), "Info": json.dumps(about),
        } | ({"unit": "mm"} if scale else {}),
    )  # fmt: skip


def read_map(path: Path) -> tuple[npt.NDArray[Any], Description]:
    """Read a map that ps4rig wrote: (H, W) or (C, H, W), and its description.

    Raises
    ------
    ValueError
        If the file is not such a map; tifffile may raise further errors for a damaged one.
    """
    with tifffile.TiffFile(path) as tiff:
        info = (
            tiff.imagej_metadata["Info"] if tiff.imagej_metadata else tiff.pages.first.description
        )
        about = json.loads(info)
        return tiff.asarray(), about
