"""The ``.ps4lib`` file: a zip of one JSON header and plain numpy arrays."""

from __future__ import annotations

import io
import json
import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from .durable_file import durable_file, require_folder
from .errors import LibraryError
from .scheme import Reference
from .spectra import ANGLES, MAX_SEGMENT_PX, MIN_SEGMENT_PX, RADII
from .surface import FloatMap

__all__ = ["SUFFIX", "VERSION", "check_path", "read", "write"]

SUFFIX = ".ps4lib"
VERSION: Final = 1
_HEADER = "library.json"
_ARRAY = "signatures.npy"
_MAX_HEADER_BYTES = 64 * 2**20
_MAX_NPY_HEADER_BYTES = 1024
# What zipfile, zlib, json and numpy raise at a damaged file; RuntimeError stands for encrypted
# members and JSON nested too deep, the last four for a broken numpy header.
_UNREADABLE = (
    zipfile.BadZipFile, zlib.error, OSError, ValueError, EOFError, RuntimeError,
    tokenize.TokenError, SyntaxError, TypeError, MemoryError,
)  # fmt: skip


class _ReferenceHeader(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    label: str = Field(min_length=1)
    orientation_deg: FiniteFloat


class _Header(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal["ps4lib"] = "ps4lib"
    version: Literal[1] = VERSION
    segment_px: int = Field(ge=MIN_SEGMENT_PX, le=MAX_SEGMENT_PX)
    simulated: bool = False
    references: tuple[_ReferenceHeader, ...] = Field(min_length=1)


def check_path(path: Path) -> None:
    """Make sure, before the work, that a library can be written to `path`.

    Raises
    ------
    LibraryError
        If the name does not end in ``.ps4lib``: it may be that of something else.
    InputError
        If there is no such folder.
    """
    if path.suffix != SUFFIX:
        raise LibraryError(f"{path}: let the name of a texture library end in {SUFFIX}")
    require_folder(path)


def write(path: Path, references: Sequence[Reference], segment_px: int, simulated: bool) -> None:
    """Write a library to `path`, whole or not at all.

    Raises
    ------
    LibraryError
        If the name does not end in ``.ps4lib``.
    InputError
        If the file cannot be written.
    """
    check_path(path)
    header = _Header(
        segment_px=segment_px,
        simulated=simulated,
        references=tuple(
            _ReferenceHeader(label=reference.label, orientation_deg=reference.orientation_deg)
            for reference in references
        ),
    )
    array = io.BytesIO()
    signatures = np.stack([reference.signature for reference in references])
    np.save(array, signatures.astype("<f4"), allow_pickle=False)
    with durable_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(_HEADER, header.model_dump_json(indent=1))
        archive.writestr(_ARRAY, array.getvalue())


def read(path: Path) -> tuple[tuple[Reference, ...], int, bool]:
    """References, segment side, whether simulated; any failure is a `LibraryError` by name."""
    try:
        with zipfile.ZipFile(path) as archive:
            header = _checked_header(_member(archive, path, _HEADER, _MAX_HEADER_BYTES), path)
            signatures = _signatures(archive, path, len(header.references))
    except FileNotFoundError as error:
        raise LibraryError(f"{path}: no such library; make one with ps4rig train") from error
    except _UNREADABLE as error:
        cause = " ".join(str(error).split())
        raise LibraryError(f"{path}: not a readable library ({cause}); train it again") from error
    if not np.isfinite(signatures).all():
        raise LibraryError(f"{path}: signatures hold NaN; the file is damaged, train it again")
    references = tuple(
        Reference(entry.label, learned, entry.orientation_deg)
        for entry, learned in zip(header.references, signatures, strict=True)
    )
    return references, header.segment_px, header.simulated


def _signatures(archive: zipfile.ZipFile, path: Path, count: int) -> FloatMap:
    """The array, its own header checked before anything is made of the size that it claims."""
    expected = (count, 2, RADII, ANGLES)
    limit = 4 * int(np.prod(expected)) + _MAX_NPY_HEADER_BYTES
    content = _member(archive, path, _ARRAY, limit)
    stream = io.BytesIO(content)
    np.lib.format.read_magic(stream)
    shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(stream)
    if shape != expected or fortran_order or dtype != np.dtype("<f4"):
        raise LibraryError(
            f"{path}: signatures are {shape} {dtype}, the header says {expected} float32; "
            "the file is damaged, train it again"
        )
    signatures: FloatMap = np.frombuffer(content, dtype, offset=stream.tell()).reshape(expected)
    return signatures


def _member(archive: zipfile.ZipFile, path: Path, name: str, limit: int) -> bytes:
    try:
        info = archive.getinfo(name)
    except KeyError as error:
        raise LibraryError(f"{path}: holds no {name}; this is not a ps4rig library") from error
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise LibraryError(f"{path}: {name} is packed in an unknown way; train it again")
    if info.file_size > limit:
        raise LibraryError(
            f"{path}: {name} claims {info.file_size} bytes; more than {limit} is refused"
        )
    return archive.read(info)


def _checked_header(content: bytes, path: Path) -> _Header:
    try:
        raw = json.loads(content)
        version = raw["version"] if isinstance(raw, dict) else None
        if isinstance(version, int) and version > VERSION:
            raise LibraryError(
                f"{path}: library version {version}, this program reads up to {VERSION}; "
                "use a newer ps4rig or train it again"
            )
        return _Header.model_validate(raw)
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError) as error:
        raise LibraryError(
            f"{path}: the header is not readable ({error}); train it again"
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise LibraryError(
            f"{path}: header field {place}: {first['msg']}; train it again"
        ) from error
