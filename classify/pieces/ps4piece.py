"""The ``.ps4piece`` file: the arrays of a piece model as an `array_archive`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from classify.base.array_archive import ArchiveKind, arrays_sha256, open_archive, write_archive
from classify.base.arrays import Array
from classify.base.durable_file import require_folder
from classify.base.errors import PieceModelError

SUFFIX = ".ps4piece"
_KIND = ArchiveKind(
    noun="piece model",
    header="pieces.json",
    version=3,
    if_missing="make one with ps4rig station teach",
    remedy="teach it again",
    error=PieceModelError,
    # Two views of 1,000 windows of 28 float32, and two of 16, take 0.4 MB.
    max_bytes=2**22,
    max_header_bytes=2**16,
)


class _Header(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal["ps4piece"] = "ps4piece"
    version: Literal[3] = 3
    sha256: str


def write(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write a model to `path`, whole or not at all; InputError if that cannot be done."""
    require_folder(path)
    write_archive(
        path, _KIND, _Header(sha256=arrays_sha256("", arrays)).model_dump_json(indent=1), arrays
    )


def read(path: Path, shapes: Mapping[str, tuple[int | None, ...]]) -> dict[str, Array]:
    """Read the arrays of a model; PieceModelError, which names the file, if it cannot be used.

    None in a shape stands for any length.
    """
    with open_archive(path, _KIND) as archive:
        header = archive.header(_Header)
        arrays = archive.finite_arrays(shapes)
        if arrays_sha256("", arrays) != header.sha256:
            raise archive.error("its arrays do not match their SHA-256: the file was changed")
    return arrays
