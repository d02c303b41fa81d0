"""The ``.ps4lib`` file: a texture library as an `array_archive`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeVar, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    FailFast,
    Field,
    FiniteFloat,
    PlainValidator,
)

from classify.base.array_archive import (
    ArchiveKind,
    ArrayArchive,
    arrays_sha256,
    open_archive,
    write_archive,
)
from classify.base.arrays import Array
from classify.base.durable_file import require_folder
from classify.base.errors import InputError, LibraryError
from classify.lighting import Lighting
from classify.methods import CLASSIFIER_NAMES, Method
from classify.texture.spectra import MAX_SEGMENT_PX, MIN_SEGMENT_PX
from classify.texture.uniformity import Uniformity

if TYPE_CHECKING:
    from .texture_library import TextureLibrary

SUFFIX = ".ps4lib"
VERSION: Final = 8
MAP_FROM_BYTES = 64 * 2**20
"""Arrays of this size or more stay in the file; smaller ones are read and their checksum tested."""

_PARAMETERS = "parameters/"
_MAX_PARAMETERS = 64
_KIND = ArchiveKind(
    noun="library",
    header="library.json",
    version=VERSION,
    if_missing="make one with ps4rig train",
    remedy="train it again",
    error=LibraryError,
    # A library of 100,000 references takes 1.1 GB (`tests.evidence.benchmark`), its header
    # 20 MB.
    max_bytes=64 * 2**30,
    max_header_bytes=64 * 2**20,
)


def _checked_limits(limits: object) -> dict[str, float]:
    if not isinstance(limits, dict):
        raise ValueError("give a number for each class")
    for label, limit in limits.items():
        if type(limit) not in (int, float) or not abs(limit) < math.inf:
            raise ValueError(f"the limit of {label!r} is not a finite number")
    return limits


def _checked_uniformity(uniformity: object) -> dict[str, Uniformity]:
    known = get_args(Uniformity)
    if not isinstance(uniformity, dict) or any(kind not in known for kind in uniformity.values()):
        raise ValueError(f"give one of {', '.join(known)} for each class")
    return uniformity


def _printable(label: str) -> str:
    if not label.isprintable():
        raise ValueError(f"{label!r} contains characters that do not print")
    return label


# `FailFast` and the checks of dictionaries end at the first error. Pydantic keeps a kilobyte of
# each error, which would turn a header of a few megabytes into gigabytes.
_Label = Annotated[str, Field(min_length=1), AfterValidator(_printable)]
_Limits = Annotated[dict[str, float], PlainValidator(_checked_limits)]
_Uniformities = Annotated[dict[str, Uniformity], PlainValidator(_checked_uniformity)]
_Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
_Library = TypeVar("_Library", bound="TextureLibrary")


class _Header(BaseModel):
    """The contents of a library except its arrays; see `TextureLibrary`."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal["ps4lib"] = "ps4lib"
    version: Literal[8] = VERSION
    classifier: str
    segment_px: int = Field(ge=MIN_SEGMENT_PX, le=MAX_SEGMENT_PX)
    method: Method | None = None
    planar: bool = False
    simulated: bool = False
    classes: Annotated[tuple[_Label, ...], FailFast()] = Field(min_length=1)
    oriented: Annotated[tuple[_Label, ...], FailFast()] = ()
    uniformity: _Uniformities = Field(default_factory=dict)
    limits: _Limits = Field(default_factory=dict)
    light_directions: Annotated[tuple[_Vector, ...] | None, FailFast()] = None
    sources: Annotated[tuple[tuple[str, str], ...], FailFast()] = ()
    sha256: str  # of the other fields and of the arrays


def write(path: Path, library: TextureLibrary) -> None:
    """Write a library to `path`, whole or not at all; InputError if its name or folder is wrong."""
    if path.suffix != SUFFIX:
        raise LibraryError(f"{path}: the name of a texture library must end in {SUFFIX}")
    require_folder(path)
    lighting = library.lighting
    header = _Header(
        classifier=library.classifier,
        segment_px=library.segment_px,
        method=library.method,
        planar=library.planar,
        simulated=library.simulated,
        classes=library.classes,
        oriented=library.oriented,
        uniformity=dict(library.uniformity),
        limits=dict(library.limits),
        light_directions=None if lighting is None else lighting.directions.tolist(),
        sources=library.sources,
        sha256="",
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
    header = header.model_copy(update={"sha256": _sha256(header, arrays)})
    write_archive(path, _KIND, header.model_dump_json(indent=1), arrays)


def _sha256(header: _Header, arrays: Mapping[str, Array]) -> str:
    return arrays_sha256(header.model_dump_json(exclude={"sha256"}), arrays)


def read(path: Path, library: type[_Library], *, map_from_bytes: int = MAP_FROM_BYTES) -> _Library:
    """Read a library; LibraryError names the file."""
    with open_archive(path, _KIND, map_from_bytes=map_from_bytes) as archive:
        return _read(archive, library)


def _read(archive: ArrayArchive, library: type[_Library]) -> _Library:
    header = archive.header(_Header)
    if header.classifier not in CLASSIFIER_NAMES:
        raise LibraryError(
            f"made for a classifier {header.classifier!r} that this program does not know; "
            "use a newer ps4rig or train it again"
        )
    indices = archive.array("classes.npy", "<i4")
    types = {"orientations_deg": "<f8", "signatures": "<f4", "invariants": "<f4"}
    if "invariants.npy" not in archive.names:
        del types["invariants"]
    arrays = {name: archive.array(f"{name}.npy", dtype) for name, dtype in types.items()}
    parameters = _parameters(archive)
    _check_references(indices, len(header.classes), arrays)
    all_arrays = (
        {"classes": indices}
        | arrays
        | {_PARAMETERS + name: values for name, values in parameters.items()}
    )
    is_mapped = False
    for array in all_arrays.values():
        # Numbers of mapped arrays are tested when a match reads them.
        if isinstance(array, np.memmap):
            is_mapped = True
        elif not np.isfinite(array).all():
            raise LibraryError("contains NaN or infinity; the file is damaged, train it again")
    if not is_mapped and header.sha256 != _sha256(header, all_arrays):
        raise archive.error("it does not match its SHA-256: the file was changed")
    try:
        directions = header.light_directions
        lighting = None if directions is None else Lighting(np.array(directions))
    except InputError as error:
        raise LibraryError(f"{error}; train it again") from error
    loaded = library(
        classifier=header.classifier,
        labels=tuple(header.classes[index] for index in indices.tolist()),
        orientations_deg=arrays["orientations_deg"],
        signatures=arrays["signatures"],
        parameters=parameters,
        segment_px=header.segment_px,
        oriented=header.oriented,
        uniformity=header.uniformity,
        limits=header.limits,
        lighting=lighting,
        method=header.method,
        planar=header.planar,
        simulated=header.simulated,
        sources=header.sources,
    )
    if "invariants" in arrays:
        # Sets the cached property, which would otherwise compute them again.
        vars(loaded)["invariants"] = arrays["invariants"]
    return loaded


def _parameters(archive: ArrayArchive) -> dict[str, Array]:
    names = [name for name in archive.names if name.startswith(_PARAMETERS)]
    if len(names) > _MAX_PARAMETERS:
        raise archive.damage_error(f"holds {len(names)} parameters")
    return {
        name.removeprefix(_PARAMETERS).removesuffix(".npy"): archive.array(name, "<f8")
        for name in names
    }


def _check_references(indices: Array, classes: int, others: dict[str, Array]) -> None:
    """Check that the arrays describe the same references."""
    count = indices.size
    one_dimensional = indices.ndim == others["orientations_deg"].ndim == 1
    equally_long = all(other.shape[:1] == (count,) for other in others.values())
    if count == 0 or not one_dimensional or not equally_long:
        shapes = ", ".join(str(other.shape) for other in others.values())
        raise LibraryError(
            f"{count} references, and arrays of {shapes}; the file is damaged, train it again"
        )
    if indices.min() < 0 or indices.max() >= classes:
        raise LibraryError("a class has no name; the file is damaged, train it again")
