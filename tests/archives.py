"""Members of archives of one JSON header and numpy arrays: libraries, calibrations, models."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt


def members(path: Path) -> dict[str, bytes]:
    """Contents of an archive by name."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write_members(
    path: Path, content: Mapping[str, bytes], compression: int = zipfile.ZIP_STORED
) -> None:
    """Write an archive of these members."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in content.items():
            archive.writestr(name, data)


def npy(array: npt.ArrayLike, **options: Any) -> bytes:
    """The bytes of an array as a file of numpy."""
    stream = io.BytesIO()
    np.save(stream, array, **options)
    return stream.getvalue()
