"""The ``.ps4cal`` file: an `array_archive` of the parts of a calibration and their records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from datetime import UTC, datetime
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Self, get_type_hints

import numpy as np
from pydantic import ConfigDict, Field, JsonValue, TypeAdapter, ValidationError

from capture.base.errors import CalibrationError
from classify import Calibration, InputError, Lighting
from classify.base import array_archive
from classify.base.arrays import Array
from classify.base.models import Record, first_fault
from classify.calibration.dark import measured_at

from .setting import PART_NAMES, PartName, Setting

SUFFIX = ".ps4cal"
_VERSION: Final = 3
_KIND = array_archive.ArchiveKind(
    noun="calibration",
    header="calibration.json",
    version=_VERSION,
    if_missing="make one with ps4rig calibrate",
    remedy="calibrate again",
    error=CalibrationError,
    # A million hot pixels take 8 MB; every other part takes less than 20 kB.
    max_bytes=64 * 2**20,
    max_header_bytes=2**20,
)
_DEPEND_ON_RESPONSE: tuple[PartName, ...] = ("flat_field", "lights")
_DTYPES = ("<f8", "<i4")


class PartRecord(Record):
    """Date, setting and quality of the measurement of a part."""

    date: str = Field(
        default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"),
        description="of the measurement",
    )
    setting: Setting = Field(description="rig, camera, frame, exposure, gain and lights of it")
    quality: str = Field(description="in words")
    figures: dict[str, float] = Field(
        default_factory=dict, description="by name; a name without a unit is a share or a count"
    )
    source: tuple[str, ...] = Field(description="captured, or the names of sets or images")
    software_version: str = Field(
        default_factory=lambda: version("ps4rig"), description="of ps4rig"
    )

    def age_days(self, at: datetime) -> int | None:
        """Return the whole days from the measurement to a time; None if its date is malformed."""
        try:
            return (at - utc_of(self.date)).days
        except ValueError:
            return None


def utc_of(date: str) -> datetime:
    """Parse an ISO 8601 date, in UTC if it has no time zone; ValueError if it is malformed."""
    moment = datetime.fromisoformat(date)
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


@dataclass(frozen=True, eq=False)
class MeasuredPart:
    """A part of a calibration with its record, and warnings about it."""

    name: PartName
    part: Any
    record: PartRecord
    warnings: tuple[str, ...] = ()

    @classmethod
    def now(
        cls,
        name: PartName,
        part: Any,
        setting: Setting,
        quality: str,
        figures: dict[str, float],
        source: Sequence[str],
        warnings: Sequence[str] = (),
    ) -> Self:
        """Return a part with the present date; for the arguments see `PartRecord`."""
        record = PartRecord(setting=setting, quality=quality, figures=figures, source=tuple(source))
        return cls(name, part, record, tuple(warnings))

    def figure(self, name: str) -> float:
        """Return a figure of the record; 0 if it is missing."""
        return self.record.figures.get(name, 0.0)


class _PartHeader(Record):
    """Record, plain values and names of the arrays of a part."""

    record: PartRecord
    values: dict[str, JsonValue]
    arrays: tuple[str, ...]


class _Header(Record):
    format: Literal["ps4cal"] = "ps4cal"
    version: Literal[3] = _VERSION
    parts: dict[PartName, _PartHeader]
    sha256: str = ""

    def hash_with(self, arrays: Mapping[str, Array]) -> str:
        """SHA-256 of all other fields and the arrays."""
        return array_archive.arrays_sha256(self.model_dump_json(exclude={"sha256"}), arrays)


class _Encoded(NamedTuple):
    """Content of a calibration file: the header, and the arrays by member name."""

    header: _Header
    arrays: dict[str, Array]


@dataclass(frozen=True, eq=False)
class CalibrationFile:
    """A calibration with the records of its parts.

    Attributes
    ----------
    records
        Record of every part, by its name.
    path
        File that it was read from; None if it was made in memory.
    """

    calibration: Calibration = field(default_factory=Calibration)
    records: Mapping[PartName, PartRecord] = field(default_factory=dict)
    path: Path | None = None
    _encoded: _Encoded | None = field(default=None, repr=False)

    @property
    def hash(self) -> str:
        """SHA-256 of parts and records, by which a set refers to this calibration."""
        return self._encoding.header.sha256

    @cached_property
    def _encoding(self) -> _Encoded:
        # A file that was read is not encoded again, because normalising the directions again may
        # change last bits, and so the hash.
        return self._encoded or _encode(self.calibration, self.records)

    def with_part(self, name: PartName, part: Any, record: PartRecord) -> CalibrationFile:
        """Return this calibration with one part added or replaced."""
        return CalibrationFile(
            replace(self.calibration, **{name: part}), {**self.records, name: record}
        )

    def without_part(self, name: PartName) -> CalibrationFile:
        """Return this calibration without one part."""
        records = {part: record for part, record in self.records.items() if part != name}
        return CalibrationFile(replace(self.calibration, **{name: None}), records)

    def differences(self, name: PartName, setting: Setting) -> list[str]:
        """Describe the differences of `setting` that make a part invalid for it."""
        measured, dark = self.records[name].setting, self.calibration.dark
        if name != "dark" or dark is None or dark.longer is None:
            return measured.differences(setting, name)
        differences = measured.model_copy(update={"exposure_ms": None}).differences(setting, name)
        if dark.holds_at(setting.exposure_ms):
            return differences
        exposure = "unknown" if setting.exposure_ms is None else f"{setting.exposure_ms:g} ms"
        return [*differences, f"exposure {exposure}, dark frames {measured_at(dark)}"]

    @property
    def outdated_parts(self) -> list[PartName]:
        """Parts that were measured before a curved response, thus without its correction."""
        response, records = self.calibration.response, self.records
        if response is None or response.linear:
            return []
        dependent = [name for name in _DEPEND_ON_RESPONSE if name in records]
        return [name for name in dependent if records[name].date < records["response"].date]

    def warnings(self) -> list[str]:
        """Warn of outdated parts."""
        names = [name.replace("_", " ") for name in self.outdated_parts]
        if not names:
            return []
        warning = (
            f"{' and '.join(names)} measured before the response, which changes their light "
            "images; run ps4rig calibrate plate again"
        )
        return [warning]

    def write(self, path: str | Path) -> None:
        """Write the file atomically; an existing file is replaced.

        Raises
        ------
        InputError
            If the name does not end in ``.ps4cal``, or the file cannot be written.
        """
        path = Path(path)
        if path.suffix != SUFFIX:
            raise InputError(f"{path}: the name of a calibration must end in {SUFFIX}")
        header, arrays = self._encoding
        array_archive.write_archive(path, _KIND, header.model_dump_json(indent=1), arrays)

    @classmethod
    def read(cls, path: str | Path) -> CalibrationFile:
        """Read a calibration.

        Raises
        ------
        CalibrationError
            If the file is missing, truncated, changed since it was written, not a calibration, or
            of another version.
        """
        path = Path(path)
        with array_archive.open_archive(path, _KIND) as archive:
            header = archive.header(_Header)
            arrays = {
                name: {key: archive.array(f"{name}/{key}.npy", *_DTYPES) for key in part.arrays}
                for name, part in header.parts.items()
            }
            members = {
                f"{name}/{key}": array for name in arrays for key, array in arrays[name].items()
            }
            if header.sha256 != header.hash_with(members):
                raise archive.error("its content does not match its SHA-256: the file was changed")
            parts = {
                name: _part(archive, name, part, arrays[name])
                for name, part in header.parts.items()
            }
        records = {name: part.record for name, part in header.parts.items()}
        return cls(Calibration(**parts), records, path, _Encoded(header, members))


def _encode(calibration: Calibration, records: Mapping[PartName, PartRecord]) -> _Encoded:
    parts: dict[PartName, _PartHeader] = {}
    members: dict[str, Array] = {}
    for name in PART_NAMES:
        part = getattr(calibration, name)
        if part is None:
            continue
        values, arrays = flattened(part)
        parts[name] = _PartHeader(record=records[name], values=values, arrays=tuple(arrays))
        members |= {f"{name}/{key}": array for key, array in arrays.items()}
    header = _Header(parts=parts)
    return _Encoded(header.model_copy(update={"sha256": header.hash_with(members)}), members)


def _part(
    archive: array_archive.ArrayArchive,
    name: PartName,
    header: _PartHeader,
    arrays: dict[str, Array],
) -> Any:
    try:
        return rebuilt(name, dict(header.values), arrays)
    except InputError as error:
        raise archive.error(f"{name}: {error}") from error


def stated_error(share: float, decimals: int) -> str:
    """Format an error in percent, as at least one unit of the last decimal."""
    return f"{max(share, 0.01 * 10.0**-decimals):.{decimals}%}"


_Values = dict[str, Any]
# Dark frames of 16 exposures are nested 15 levels deep.
_MAX_LEVELS = 20


def flattened(part: Any) -> tuple[_Values, dict[str, Array]]:
    """Plain values and arrays of a part, by the dotted path of the field."""
    values: _Values = {}
    arrays: dict[str, Array] = {}

    def flatten(owner: Any, path: str) -> None:
        for entry in fields(owner):
            value, name = getattr(owner, entry.name), path + entry.name
            is_intensities = isinstance(owner, Lighting) and entry.name == "intensities"
            is_default = is_intensities and not owner.intensities_given
            if is_default or not entry.init:
                continue
            if isinstance(value, np.ndarray):
                arrays[name] = value
            elif is_dataclass(value):
                flatten(value, name + ".")
            else:
                values[name] = value

    flatten(part, "")
    return values, arrays


def rebuilt(name: PartName, values: _Values, arrays: dict[str, Array]) -> Any:
    """Rebuild a part from its values and arrays: the inverse of `flattened`."""
    tree: dict[str, Any] = {}
    for path, leaf in (values | arrays).items():
        *parents, last = path.split(".")
        if len(parents) > _MAX_LEVELS:
            raise InputError(f"fields are nested more than {_MAX_LEVELS} times")
        table = tree
        for parent in parents:
            table = table.setdefault(parent, {})
            if not isinstance(table, dict):
                raise InputError(f"field {path} has the wrong type")
        table[last] = leaf
    try:
        return _adapter_of(name).validate_python(tree)
    except ValidationError as error:
        raise InputError(f"field {first_fault(error)}") from error


@cache
def _adapter_of(name: PartName) -> TypeAdapter[Any]:
    config = ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=False, extra="forbid")
    return TypeAdapter(get_type_hints(Calibration)[name], config=config)
