"""The maps of a solved set as files: float32 TIFF for programs, PNG for people."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import numpy.typing as npt
import tifffile

from classify import SurfaceEstimate, integrate_gradients
from classify.durable_file import durable_file, make_folder

from . import pictures
from .captured_set import CapturedSet

__all__ = ["write_maps"]


def write_maps(captured: CapturedSet, surface: SurfaceEstimate, folder: Path) -> list[Path]:
    """Write p, q, albedo, normals, height and residual as TIFF; shadow, valid, preview as PNG.

    The TIFFs' descriptions are JSON that says what set they come from, and whether simulated.
    `height.tif` is relative: in pixels, zero mean, from the gradients alone.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    make_folder(folder)
    maps = {
        "p": surface.p,
        "q": surface.q,
        "albedo": surface.albedo,
        "normals": surface.normals,
        "height": integrate_gradients(surface.p, surface.q),
        "residual": surface.residual,
    }
    origin = json.dumps(
        {
            "method": surface.method,
            "simulated": captured.metadata.simulated,
            "label": captured.label,
            "pixels_sha256": captured.metadata.pixels_sha256,
            "software_version": version("ps4rig"),
        }
    )
    written = [_write_tiff(folder / f"{name}.tif", values, origin) for name, values in maps.items()]
    shown = {**pictures.light_pictures(captured), **pictures.surface_pictures(surface)}
    views = {
        "shadow": pictures.shadow_map(surface),
        "valid": pictures.grey(surface.valid, top=1.0),
        "preview": pictures.contact_sheet(shown),
    }
    for name, picture in views.items():
        path = folder / f"{name}.png"
        with durable_file(path) as temporary:
            temporary.write_bytes(pictures.png_bytes(picture))
        written.append(path)
    return written


def _write_tiff(path: Path, values: npt.NDArray[np.float32], origin: str) -> Path:
    photometric = "rgb" if values.ndim == 3 else "minisblack"
    with durable_file(path) as temporary:
        tifffile.imwrite(
            temporary,
            values.astype(np.float32),
            photometric=photometric,
            description=origin,
            metadata=None,
        )
    return path
