"""The ``.ps4lib`` file: a zip of one JSON header and plain numpy arrays, none of them packed.

A member that is stored as it is can be mapped into memory, so that a library of 100,000
references opens at once and only those that are asked for are read.
"""

from __future__ import annotations

import json
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from classify.durable_file import durable_file, require_folder
from classify.errors import LibraryError
from classify.methods import CLASSIFIER_NAMES
from classify.surface.estimate import FloatMap
from classify.texture.spectra import MAX_SEGMENT_PX, MIN_SEGMENT_PX

__all__ = ["SUFFIX", "VERSION", "Contents", "Header", "check_path", "read", "write"]

SUFFIX = ".ps4lib"
VERSION: Final = 3
_HEADER = "library.json"
_PARAMETERS = "parameters/"
_MAX_HEADER_BYTES = 256 * 2**20
_MAX_ARRAY_BYTES = 64 * 2**30
_MAX_PARAMETERS = 64
# Larger arrays stay in the file. Smaller ones are read at once and their checksum with them.
_MAPPED_FROM_BYTES = 64 * 2**20
_LOCAL_HEADER = struct.Struct("<4s5H3I2H")
# What zipfile, zlib, json and numpy raise at a damaged file; RuntimeError stands for encrypted
# members and JSON nested too deep, the last four for a broken numpy header.
_UNREADABLE = (
    zipfile.BadZipFile, zlib.error, OSError, ValueError, EOFError, RuntimeError, struct.error,
    tokenize.TokenError, SyntaxError, TypeError, MemoryError,
)  # fmt: skip

Label = Annotated[str, Field(min_length=1)]
Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class Header(BaseModel):
    """What a library says in words and single numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal["ps4lib"] = "ps4lib"
    version: Literal[3] = VERSION
    classifier: str
    segment_px: int = Field(ge=MIN_SEGMENT_PX, le=MAX_SEGMENT_PX)
    simulated: bool = False
    classes: tuple[Label, ...] = Field(min_length=1)
    limits: dict[str, FiniteFloat] = Field(default_factory=dict)
    light_directions: tuple[Vector, ...] | None = None
    sources: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Contents:
    """A header and the arrays beside it; see `TextureLibrary` for their meaning."""

    header: Header
    class_indices: npt.NDArray[np.int32]
    orientations_deg: npt.NDArray[np.float64]
    signatures: FloatMap
    parameters: Mapping[str, npt.NDArray[np.float64]]
    invariants: FloatMap | None = None


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


def write(path: Path, contents: Contents) -> None:
    """Write a library to `path`, whole or not at all.

    Raises
    ------
    LibraryError
        If the name does not end in ``.ps4lib``.
    InputError
        If the file cannot be written.
    """
    check_path(path)
    arrays: dict[str, npt.NDArray[Any]] = {
        "classes": contents.class_indices.astype("<i4"),
        "orientations_deg": contents.orientations_deg.astype("<f8"),
        "signatures": contents.signatures.astype("<f4", copy=False),
    }
    if contents.invariants is not None:
        arrays["invariants"] = contents.invariants.astype("<f4", copy=False)
    for name, values in contents.parameters.items():
        arrays[_PARAMETERS + name] = values.astype("<f8")
    with durable_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(_HEADER, contents.header.model_dump_json(indent=1))
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                # Not `ascontiguousarray`, which makes a list of a single number.
                plain = np.asarray(array, order="C")
                np.lib.format.write_array(member, plain, allow_pickle=False)


def read(path: Path) -> Contents:
    """Read a library; any failure is a `LibraryError` that names the file."""
    try:
        with zipfile.ZipFile(path) as archive:
            header = _checked_header(_small_member(archive, path, _HEADER), path)
            contents = _contents(archive, path, header)
    except FileNotFoundError as error:
        raise LibraryError(f"{path}: no such library; make one with ps4rig train") from error
    except _UNREADABLE as error:
        cause = " ".join(str(error).split())
        raise LibraryError(f"{path}: not a readable library ({cause}); train it again") from error
    _check_numbers(contents, path)
    return contents


def _contents(archive: zipfile.ZipFile, path: Path, header: Header) -> Contents:
    names = [name for name in archive.namelist() if name.startswith(_PARAMETERS)]
    if len(names) > _MAX_PARAMETERS:
        raise LibraryError(f"{path}: holds {len(names)} parameters; the file is damaged")
    invariants = None
    if "invariants.npy" in archive.namelist():
        invariants = _array(archive, path, "invariants.npy", "<f4")
    return Contents(
        header=header,
        class_indices=_array(archive, path, "classes.npy", "<i4"),
        orientations_deg=_array(archive, path, "orientations_deg.npy", "<f8"),
        signatures=_array(archive, path, "signatures.npy", "<f4"),
        parameters={
            name.removeprefix(_PARAMETERS).removesuffix(".npy"): _array(archive, path, name, "<f8")
            for name in names
        },
        invariants=invariants,
    )


def _check_numbers(contents: Contents, path: Path) -> None:
    """That the arrays belong together; their values too, but for those still in the file."""
    count = contents.class_indices.size
    others: list[npt.NDArray[Any]] = [contents.orientations_deg, contents.signatures]
    if contents.invariants is not None:
        others.append(contents.invariants)
    lists = (contents.class_indices, contents.orientations_deg)
    if (
        count == 0
        or any(each.ndim != 1 for each in lists)
        or any(other.shape[:1] != (count,) for other in others)
    ):
        raise LibraryError(
            f"{path}: {count} references, and arrays of "
            f"{', '.join(str(other.shape) for other in others)}; the file is damaged, "
            "train it again"
        )
    indices = contents.class_indices
    if indices.min() < 0 or indices.max() >= len(contents.header.classes):
        raise LibraryError(f"{path}: a class has no name; the file is damaged, train it again")
    for array in [*others, *contents.parameters.values()]:
        if not isinstance(array, np.memmap) and not np.isfinite(array).all():
            raise LibraryError(f"{path}: holds NaN; the file is damaged, train it again")


def _array(archive: zipfile.ZipFile, path: Path, name: str, dtype: str) -> npt.NDArray[Any]:
    """One array, read or mapped; its own header is checked before its size is believed."""
    info = _member_info(archive, path, name, _MAX_ARRAY_BYTES)
    with archive.open(info) as member:
        np.lib.format.read_magic(member)
        shape, fortran_order, found = np.lib.format.read_array_header_1_0(member)
        header_bytes = member.tell()
        values_bytes = info.file_size - header_bytes
        if found != np.dtype(dtype) or fortran_order or _bytes_of(shape, found) != values_bytes:
            raise LibraryError(
                f"{path}: {name} is {shape} {found} in {values_bytes} bytes; "
                "the file is damaged, train it again"
            )
        if info.file_size < _MAPPED_FROM_BYTES:
            return np.frombuffer(member.read(), found).reshape(shape)
    if info.compress_type != zipfile.ZIP_STORED:
        raise LibraryError(f"{path}: {name} is packed; train it again")
    start = _start_of_member(path, info) + header_bytes
    return np.memmap(path, found, mode="r", offset=start, shape=shape)


def _bytes_of(shape: tuple[int, ...], dtype: np.dtype[Any]) -> int:
    count = dtype.itemsize
    for length in shape:
        count *= length
    return count


def _start_of_member(path: Path, info: zipfile.ZipInfo) -> int:
    """Where the bytes of a stored member begin: behind a header of its own, not the directory's."""
    with path.open("rb") as file:
        file.seek(info.header_offset)
        fields = _LOCAL_HEADER.unpack(file.read(_LOCAL_HEADER.size))
    if fields[0] != b"PK\x03\x04":
        raise zipfile.BadZipFile(f"no member begins at {info.header_offset}")
    return info.header_offset + _LOCAL_HEADER.size + int(fields[9]) + int(fields[10])


def _small_member(archive: zipfile.ZipFile, path: Path, name: str) -> bytes:
    return archive.read(_member_info(archive, path, name, _MAX_HEADER_BYTES))


def _member_info(archive: zipfile.ZipFile, path: Path, name: str, limit: int) -> zipfile.ZipInfo:
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
    return info


def _checked_header(content: bytes, path: Path) -> Header:
    try:
        raw = json.loads(content)
        version = raw["version"] if isinstance(raw, dict) else None
        if isinstance(version, int) and version != VERSION:
            which = "use a newer ps4rig or train" if version > VERSION else "train"
            raise LibraryError(
                f"{path}: library version {version}, this program reads {VERSION}; {which} it again"
            )
        header = Header.model_validate(raw)
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
    if header.classifier not in CLASSIFIER_NAMES:
        raise LibraryError(
            f"{path}: made for a classifier {header.classifier!r} that this program does not know; "
            "use a newer ps4rig or train it again"
        )
    return header
