"""Files of one JSON header and plain numpy arrays, in a zip without compression.

Libraries, calibrations and defect models are such files. A file may come from anywhere: it is
checked before it is used. A stored array can be mapped into memory: a library of 100,000 references
opens at once, and only the signatures that a match needs are read.
"""

import hashlib
import json
import math
import mmap
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from classify.base.arrays import Array

from .durable_file import durable_file, require_folder
from .errors import InputError
from .regular_file import open_regular_file

_Header = TypeVar("_Header", bound=BaseModel)

# Members are stored, not compressed; a copy compressed by another program has half the size. A file
# whose members declare more than this multiple of its size would fill the memory (test_ps4lib.py).
_MAX_COMPRESSION = 16
_COMPRESSION_SLACK_BYTES = 2**20
# Header of a member: signature, eight fields, and the lengths of name and extra field after it.
_LOCAL_HEADER = struct.Struct("<4s5H3I2H")
# Errors of zipfile, zlib, json and numpy for a damaged file: RuntimeError for encrypted members and
# JSON nested too deep, the last four for a broken numpy header.
_UNREADABLE = (
    zipfile.BadZipFile, zlib.error, OSError, ValueError, EOFError, RuntimeError, struct.error,
    tokenize.TokenError, SyntaxError, TypeError, MemoryError,
)  # fmt: skip


@dataclass(frozen=True)
class ArchiveKind:
    """One kind of archive."""

    noun: str  # its name in messages
    header: str  # name of the JSON inside
    version: int
    if_missing: str  # what to do without such a file
    remedy: str  # what to do with one that cannot be read
    error: type[InputError]  # class of all its errors
    max_bytes: int
    max_header_bytes: int


class ArrayArchive:
    """Members of an open archive, checked before reading; `open_archive` adds the file name."""

    def __init__(
        self, kind: ArchiveKind, archive: zipfile.ZipFile, file: BinaryIO, map_from_bytes: float
    ) -> None:
        self._kind = kind
        self._archive = archive
        self._file = file
        self._map_from_bytes = map_from_bytes
        self.names = archive.namelist()
        file_bytes = file.seek(0, 2)
        declared = sum(info.file_size for info in archive.infolist())
        if declared > _MAX_COMPRESSION * file_bytes + _COMPRESSION_SLACK_BYTES:
            raise self.damage_error(f"declares {declared} bytes in a file of {file_bytes}")

    def error(self, problem: str) -> InputError:
        """Return an error that ends with the remedy."""
        return self._kind.error(f"{problem}; {self._kind.remedy}")

    def damage_error(self, problem: str) -> InputError:
        """Return an error of a file that no version of this program wrote."""
        return self._kind.error(f"{problem}; the file is damaged, {self._kind.remedy}")

    def header(self, model: type[_Header]) -> _Header:
        """Return the validated header; `model` has a field `version`."""
        kind = self._kind
        info = self._member(kind.header)
        if info.file_size > kind.max_header_bytes:
            raise self.error(
                f"{kind.header} has {info.file_size} bytes, over {kind.max_header_bytes}"
            )
        try:
            raw = json.loads(self._archive.read(info))
            if not isinstance(raw, dict):
                raise self.error("the header is not a JSON object")
            version = raw["version"]
            if isinstance(version, int) and version != kind.version:
                newer = "use a newer ps4rig or " if version > kind.version else ""
                raise kind.error(
                    f"{kind.noun} version {version}; this program reads {kind.version}; "
                    f"{newer}{kind.remedy}"
                )
            unknown = raw.keys() - model.model_fields
            if unknown:
                raise self.error(f"header field {min(unknown)!r} is unknown")
            return model.model_validate(raw)
        except (json.JSONDecodeError, UnicodeDecodeError, KeyError) as error:
            raise self.error(f"the header is not readable ({error})") from error
        except ValidationError as error:
            first = error.errors()[0]
            field = ".".join(map(str, first["loc"]))
            raise self.error(f"header field {field}: {first['msg']}") from error

    def array(self, name: str, *dtypes: str) -> Array:
        """One array of one of these types, read or mapped, after its header was checked."""
        info = self._member(name)
        with self._archive.open(info) as member:
            np.lib.format.read_magic(member)
            shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(member)
            header_bytes = member.tell()
            values_bytes = info.file_size - header_bytes
            fits = math.prod(shape) * dtype.itemsize == values_bytes
            if dtype not in map(np.dtype, dtypes) or fortran_order or not fits:
                raise self.damage_error(f"{name} is {shape} {dtype} in {values_bytes} bytes")
            if info.file_size < self._map_from_bytes:
                return np.frombuffer(member.read(), dtype).reshape(shape)
        if info.compress_type != zipfile.ZIP_STORED:
            raise self.error(f"{name} is compressed")
        offset = self._offset(info) + header_bytes
        return np.memmap(self._file, dtype, mode="r", offset=offset, shape=shape)

    def _member(self, name: str) -> zipfile.ZipInfo:
        try:
            info = self._archive.getinfo(name)
        except KeyError as error:
            noun = self._kind.noun
            raise self._kind.error(f"holds no {name}; this is not a ps4rig {noun}") from error
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self.error(f"{name} is compressed by an unknown method")
        return info

    def _offset(self, info: zipfile.ZipInfo) -> int:
        """Offset of the bytes of a stored member, which follow its own header in the file."""
        self._file.seek(info.header_offset)
        fields = _LOCAL_HEADER.unpack(self._file.read(_LOCAL_HEADER.size))
        signature, *_, name_bytes, extra_bytes = fields
        if signature != b"PK\x03\x04":
            raise zipfile.BadZipFile(f"no member begins at {info.header_offset}")
        return info.header_offset + _LOCAL_HEADER.size + int(name_bytes) + int(extra_bytes)


def is_cut_short(array: Array) -> bool:
    """Whether the file of a mapped array became too short; reading it would end the process."""
    return (
        isinstance(array, np.memmap)
        and isinstance(array.base, mmap.mmap)
        and array.base.size() < array.offset + array.nbytes
    )


@contextmanager
def open_archive(
    path: Path, kind: ArchiveKind, *, map_from_bytes: float = math.inf
) -> Iterator[ArrayArchive]:
    """Open an archive; arrays of `map_from_bytes` or more stay in the file."""
    try:
        with open_regular_file(path, kind.max_bytes) as file, zipfile.ZipFile(file) as archive:
            yield ArrayArchive(kind, archive, file, map_from_bytes)
    except kind.error as error:
        raise kind.error(f"{path}: {error}") from error
    except InputError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise kind.error(f"{path}: no such {kind.noun}; {kind.if_missing}") from error
        raise kind.error(str(error)) from error
    except _UNREADABLE as error:
        cause = " ".join(str(error).split())
        raise kind.error(f"{path}: not a readable {kind.noun} ({cause}); {kind.remedy}") from error


def write_archive(path: Path, kind: ArchiveKind, header: str, arrays: Mapping[str, Array]) -> None:
    """Write an archive of a JSON header and named arrays, whole or not at all."""
    with durable_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(kind.header, header)
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                # `ascontiguousarray` would turn a single number into an array of one dimension.
                plain = np.asarray(array, order="C")
                np.lib.format.write_array(member, plain, allow_pickle=False)


def arrays_sha256(text: str, arrays: Mapping[str, Array]) -> str:
    """SHA-256 over a text, and over arrays with their names, types and shapes."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        plain = np.ascontiguousarray(arrays[name])
        digest.update(f" {name} {plain.dtype.str} {plain.shape} ".encode())
        digest.update(plain.tobytes())
    return digest.hexdigest()


class _ArraysHeader(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    version: int
    sha256: str  # over the arrays


def write_arrays(path: Path, kind: ArchiveKind, arrays: Mapping[str, Array]) -> None:
    """Write a file of nothing but arrays, whole or not at all."""
    require_folder(path)
    header = _ArraysHeader(version=kind.version, sha256=arrays_sha256("", arrays))
    write_archive(path, kind, header.model_dump_json(indent=1), arrays)


def read_arrays(
    path: Path, kind: ArchiveKind, shapes: Mapping[str, tuple[int | None, ...]]
) -> dict[str, Array]:
    """Read finite float32 or float64 arrays; None in a shape stands for any length."""
    with open_archive(path, kind) as archive:
        header = archive.header(_ArraysHeader)
        arrays = {name: archive.array(f"{name}.npy", "<f4", "<f8") for name in shapes}
        for name, shape in shapes.items():
            stored = arrays[name].shape
            if len(stored) != len(shape) or any(
                side not in (None, length) for side, length in zip(shape, stored, strict=True)
            ):
                raise archive.damage_error(f"{name} has the shape {stored} instead of {shape}")
            if not np.isfinite(arrays[name]).all():
                raise archive.damage_error(f"{name} contains NaN or infinity")
        if arrays_sha256("", arrays) != header.sha256:
            raise archive.error("its arrays do not match their SHA-256: the file was changed")
    return arrays
