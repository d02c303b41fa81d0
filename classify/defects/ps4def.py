"""The ``.ps4def`` file: the arrays of a defect model as an `array_archive`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from classify.base.array_archive import ArchiveKind, arrays_sha256, open_archive, write_archive
from classify.base.arrays import Array
from classify.base.durable_file import require_folder
from classify.base.errors import DefectModelError

SUFFIX = ".ps4def"
_VERSION: Final = 3
_KIND = ArchiveKind(
    noun="defect model",
    header="defects.json",
    version=_VERSION,
    if_missing="make one with ps4rig station teach",
    remedy="teach it again",
    error=DefectModelError,
    # A model takes 180 kB, and 8 bytes for each of at most 100 good parts.
    max_bytes=2**22,
    max_header_bytes=2**16,
)


class _Header(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal["ps4def"] = "ps4def"
    version: Literal[3] = _VERSION
    false_alarm_rate: float = Field(gt=0.0, lt=0.5)
    sha256: str


def write(path: Path, false_alarm_rate: float, arrays: Mapping[str, Array]) -> None:
    """Write a model, whole or not at all; DefectModelError if its name has another suffix."""
    if path.suffix != SUFFIX:
        raise DefectModelError(f"{path}: let the name of a defect model end in {SUFFIX}")
    require_folder(path)
    sha256 = digest(false_alarm_rate, arrays)
    header = _Header(false_alarm_rate=false_alarm_rate, sha256=sha256)
    write_archive(path, _KIND, header.model_dump_json(indent=1), arrays)


def read(
    path: Path, shapes: Mapping[str, tuple[int | None, ...]]
) -> tuple[float, dict[str, Array]]:
    """Read the false alarm rate and the arrays, whose names are those of `shapes`."""
    with open_archive(path, _KIND) as archive:
        header = archive.header(_Header)
        arrays = archive.finite_arrays(shapes)
        if digest(header.false_alarm_rate, arrays) != header.sha256:
            raise archive.error("its arrays do not match their SHA-256: the file was changed")
    return header.false_alarm_rate, arrays


def digest(false_alarm_rate: float, arrays: Mapping[str, Array]) -> str:
    """SHA-256 over version, rate and arrays."""
    return arrays_sha256(f"{_VERSION} {false_alarm_rate!r}", arrays)
