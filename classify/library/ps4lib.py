"""The ``.ps4lib`` file: a zip of one JSON header and plain numpy arrays, stored unpacked.

A stored array can be mapped into memory: a library of 100,000 references opens at once, and only
the signatures that a match needs are read.
"""

import json
import math
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Final, Literal, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    FailFast,
    Field,
    FiniteFloat,
    PlainValidator,
    ValidationError,
)

from classify.durable_file import durable_file, require_folder
from classify.errors import InputError, LibraryError
from classify.lighting import Lighting
from classify.methods import CLASSIFIER_NAMES, Method
from classify.regular_file import open_regular_file
from classify.texture.spectra import MAX_SEGMENT_PX, MIN_SEGMENT_PX

from .contents import LibraryContents

SUFFIX = ".ps4lib"
VERSION: Final = 4
# Version 3 has no `method`; the arrays are the same.
_READABLE = (3, 4)
MAP_FROM_BYTES = 64 * 2**20
"""Arrays of this size or more stay in the file; smaller ones are read and their checksum tested."""

_HEADER = "library.json"
_PARAMETERS = "parameters/"
_MAX_PARAMETERS = 64
# A library of 100,000 references takes 1.1 GB (`ps4rig bench`), its header 20 MB.
_MAX_FILE_BYTES = 64 * 2**30
_MAX_HEADER_BYTES = 64 * 2**20
# Members are stored, not packed; a copy packed by another program is smaller by half. A file whose
# members declare more than this multiple of its size would fill the memory: see test_ps4lib.py.
_MAX_PACKING = 16
_PACKING_SLACK_BYTES = 2**20
_LOCAL_HEADER = struct.Struct("<4s5H3I2H")
# What zipfile, zlib, json and numpy raise for a damaged file; RuntimeError stands for encrypted
# members and JSON nested too deep, the last four for a broken numpy header.
_UNREADABLE = (
    zipfile.BadZipFile, zlib.error, OSError, ValueError, EOFError, RuntimeError, struct.error,
    tokenize.TokenError, SyntaxError, TypeError, MemoryError,
)  # fmt: skip


def _checked_limits(limits: object) -> dict[str, float]:
    if not isinstance(limits, dict):
        raise ValueError("give a number for each class")
    for label, limit in limits.items():
        if type(limit) not in (int, float) or not abs(limit) < math.inf:
            raise ValueError(f"the limit of {label!r} is not a finite number")
    return limits


def _printable(label: str) -> str:
    if not label.isprintable():
        raise ValueError(f"{label!r} contains characters that do not print")
    return label


# `FailFast` and the check of limits end at the first error. Pydantic keeps a kilobyte of each
# error, which would turn a header of a few megabytes into gigabytes.
Label = Annotated[str, Field(min_length=1), AfterValidator(_printable)]
Limits = Annotated[dict[str, float], PlainValidator(_checked_limits)]
Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Library = TypeVar("Library", bound=LibraryContents)
Array = npt.NDArray[Any]


class _Header(BaseModel):
    """The contents of a library except its arrays; see `LibraryContents`."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal["ps4lib"] = "ps4lib"
    version: Literal[3, 4] = VERSION
    classifier: str
    segment_px: int = Field(ge=MIN_SEGMENT_PX, le=MAX_SEGMENT_PX)
    method: Method | None = None
    planar: bool = False
    simulated: bool = False
    classes: Annotated[tuple[Label, ...], FailFast()] = Field(min_length=1)
    limits: Limits = Field(default_factory=dict)
    light_directions: Annotated[tuple[Vector, ...] | None, FailFast()] = None
    sources: Annotated[tuple[tuple[str, str], ...], FailFast()] = ()


class _Archive:
    """The members of an open library, checked before they are read; errors do not name the file."""

    def __init__(self, archive: zipfile.ZipFile, file: BinaryIO, map_from_bytes: int) -> None:
        self._archive = archive
        self._file = file
        self._map_from_bytes = map_from_bytes
        self.names = archive.namelist()
        file_bytes = file.seek(0, 2)
        declared = sum(info.file_size for info in archive.infolist())
        if declared > _MAX_PACKING * file_bytes + _PACKING_SLACK_BYTES:
            raise LibraryError(
                f"declares {declared} bytes in a file of {file_bytes}; "
                "the file is damaged, train it again"
            )

    def header(self) -> bytes:
        info = self._member(_HEADER)
        if info.file_size > _MAX_HEADER_BYTES:
            raise LibraryError(
                f"{_HEADER} has {info.file_size} bytes, over {_MAX_HEADER_BYTES}; train it again"
            )
        return self._archive.read(info)

    def parameters(self) -> dict[str, Array]:
        names = [name for name in self.names if name.startswith(_PARAMETERS)]
        if len(names) > _MAX_PARAMETERS:
            raise LibraryError(
                f"holds {len(names)} parameters; the file is damaged, train it again"
            )
        return {
            name.removeprefix(_PARAMETERS).removesuffix(".npy"): self.array(name, "<f8")
            for name in names
        }

    def array(self, name: str, dtype: str) -> Array:
        """One array, read or mapped, after its header was checked."""
        info = self._member(name)
        with self._archive.open(info) as member:
            np.lib.format.read_magic(member)
            shape, fortran_order, found = np.lib.format.read_array_header_1_0(member)
            header_bytes = member.tell()
            values_bytes = info.file_size - header_bytes
            fits = math.prod(shape) * found.itemsize == values_bytes
            if found != np.dtype(dtype) or fortran_order or not fits:
                raise LibraryError(
                    f"{name} is {shape} {found} in {values_bytes} bytes; "
                    "the file is damaged, train it again"
                )
            if info.file_size < self._map_from_bytes:
                return np.frombuffer(member.read(), found).reshape(shape)
        if info.compress_type != zipfile.ZIP_STORED:
            raise LibraryError(f"{name} is packed; train it again")
        start = self._start(info) + header_bytes
        return np.memmap(self._file, found, mode="r", offset=start, shape=shape)

    def _member(self, name: str) -> zipfile.ZipInfo:
        try:
            info = self._archive.getinfo(name)
        except KeyError as error:
            raise LibraryError(f"holds no {name}; this is not a ps4rig library") from error
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise LibraryError(f"{name} is packed in an unknown way; train it again")
        return info

    def _start(self, info: zipfile.ZipInfo) -> int:
        """Offset of the bytes of a stored member, which follow its own header."""
        self._file.seek(info.header_offset)
        fields = _LOCAL_HEADER.unpack(self._file.read(_LOCAL_HEADER.size))
        if fields[0] != b"PK\x03\x04":
            raise zipfile.BadZipFile(f"no member begins at {info.header_offset}")
        return info.header_offset + _LOCAL_HEADER.size + int(fields[9]) + int(fields[10])


def check_path(path: Path) -> None:
    """Check before the work that a library can be written to `path`.

    LibraryError if the name does not end in ``.ps4lib``, because the file may be something else;
    InputError if there is no such folder.
    """
    if path.suffix != SUFFIX:
        raise LibraryError(f"{path}: let the name of a texture library end in {SUFFIX}")
    require_folder(path)


def write(path: Path, library: LibraryContents) -> None:
    """Write a library to `path`, whole or not at all; raises as `check_path`."""
    check_path(path)
    lighting = library.lighting
    header = _Header(
        classifier=library.classifier,
        segment_px=library.segment_px,
        method=library.method,
        planar=library.planar,
        simulated=library.simulated,
        classes=library.classes,
        limits=dict(library.limits),
        light_directions=None if lighting is None else lighting.directions.tolist(),
        sources=library.sources,
    )
    arrays: dict[str, Array] = {
        "classes": library.class_indices.astype("<i4"),
        "orientations_deg": library.orientations_deg.astype("<f8"),
        "signatures": library.signatures.astype("<f4", copy=False),
    }
    if library.invariants is not None:
        arrays["invariants"] = library.invariants.astype("<f4", copy=False)
    for name, values in library.parameters.items():
        arrays[_PARAMETERS + name] = values.astype("<f8")
    with durable_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(_HEADER, header.model_dump_json(indent=1))
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                # `ascontiguousarray` would make a list of a single number.
                plain = np.asarray(array, order="C")
                np.lib.format.write_array(member, plain, allow_pickle=False)


def read(path: Path, kind: type[Library], *, map_from_bytes: int = MAP_FROM_BYTES) -> Library:
    """Read a library as an object of `kind`; any failure is a `LibraryError` naming the file."""
    try:
        with open_regular_file(path, _MAX_FILE_BYTES) as file, zipfile.ZipFile(file) as archive:
            return _read(_Archive(archive, file, map_from_bytes), kind)
    except LibraryError as error:
        raise LibraryError(f"{path}: {error}") from error
    except InputError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise LibraryError(f"{path}: no such library; make one with ps4rig train") from error
        raise LibraryError(str(error)) from error
    except _UNREADABLE as error:
        cause = " ".join(str(error).split())
        raise LibraryError(f"{path}: not a readable library ({cause}); train it again") from error


def _read(archive: _Archive, kind: type[Library]) -> Library:
    header = _checked_header(archive.header())
    indices = archive.array("classes.npy", "<i4")
    types = {"orientations_deg": "<f8", "signatures": "<f4", "invariants": "<f4"}
    if "invariants.npy" not in archive.names:
        del types["invariants"]
    arrays = {name: archive.array(f"{name}.npy", dtype) for name, dtype in types.items()}
    parameters = archive.parameters()
    _check_references(indices, len(header.classes), arrays)
    for array in [*arrays.values(), *parameters.values()]:
        # Numbers of mapped arrays are tested when a match reads them.
        if not isinstance(array, np.memmap) and not np.isfinite(array).all():
            raise LibraryError("contains NaN or infinity; the file is damaged, train it again")
    try:
        directions = header.light_directions
        lighting = None if directions is None else Lighting(np.array(directions))
    except InputError as error:
        raise LibraryError(f"{error}; train it again") from error
    library = kind(
        classifier=header.classifier,
        labels=tuple(header.classes[index] for index in indices.tolist()),
        orientations_deg=arrays["orientations_deg"],
        signatures=arrays["signatures"],
        parameters=parameters,
        segment_px=header.segment_px,
        limits=header.limits,
        lighting=lighting,
        method=header.method,
        planar=header.planar,
        simulated=header.simulated,
        sources=header.sources,
    )
    if "invariants" in arrays:
        # The cached property, which would compute them anew.
        vars(library)["invariants"] = arrays["invariants"]
    return library


def _checked_header(content: bytes) -> _Header:
    try:
        raw = json.loads(content)
        if not isinstance(raw, dict):
            raise LibraryError("the header is not a JSON object; train it again")
        version = raw["version"]
        if isinstance(version, int) and version not in _READABLE:
            which = "use a newer ps4rig or train" if version > VERSION else "train"
            raise LibraryError(
                f"library version {version}, this program reads {VERSION}; {which} it again"
            )
        unknown = raw.keys() - _Header.model_fields
        if unknown:
            raise LibraryError(f"header field {min(unknown)!r} is unknown; train it again")
        header = _Header.model_validate(raw)
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError) as error:
        raise LibraryError(f"the header is not readable ({error}); train it again") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise LibraryError(f"header field {place}: {first['msg']}; train it again") from error
    if header.classifier not in CLASSIFIER_NAMES:
        raise LibraryError(
            f"made for a classifier {header.classifier!r} that this program does not know; "
            "use a newer ps4rig or train it again"
        )
    return header


def _check_references(indices: Array, classes: int, others: dict[str, Array]) -> None:
    """Check that the arrays describe the same references."""
    count = indices.size
    one_dimensional = indices.ndim == others["orientations_deg"].ndim == 1
    equal = all(other.shape[:1] == (count,) for other in others.values())
    if count == 0 or not one_dimensional or not equal:
        shapes = ", ".join(str(other.shape) for other in others.values())
        raise LibraryError(
            f"{count} references, and arrays of {shapes}; the file is damaged, train it again"
        )
    if indices.min() < 0 or indices.max() >= classes:
        raise LibraryError("a class has no name; the file is damaged, train it again")
