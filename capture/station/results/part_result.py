"""`PartResult`: the id of a part and its result, a row of the database that is never changed."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, astuple, dataclass, field, fields
from enum import StrEnum
from functools import cached_property
from typing import Any, get_type_hints

from capture.base.outputs import escaped
from capture.station.domain.limits import LimitedMeasures
from capture.station.domain.verdict import Cause, Decision, Verdict
from classify.base.errors import InputError

# Fields that are measured numbers, None where nothing was measured.
MEASURES = (
    "orientation_deg", "orientation_period_deg", "distance", "limit", "margin", "blur_px",
    *(measure.name for measure in fields(LimitedMeasures)),
)  # fmt: skip
# Largest number of characters of a text: an exception may contain a whole document.
MAX_TEXT = 2000
_MAX_INTEGER = 2**63 - 1  # of a column, in SQLite and in PostgreSQL
_MAX_LENGTH = 100
# Ids are also file names on every system: no leading dot, no blank.
_PART_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
# Windows reserves the names of devices, with any suffix.
_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
# Times with milliseconds sort as their texts do.
_UTC = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z")
_GENERATED_ID = re.compile(r"part-\d+", re.IGNORECASE)


def generated_part_id(number: int) -> str:
    """Return the id of a part whose trigger gave none."""
    return f"part-{number:06d}"


def bounded_part_id(text: str) -> str:
    """Shorten and escape the id of a request; an invalid id stays invalid."""
    return text[: _MAX_LENGTH + 1].encode("utf-8", "backslashreplace").decode()


def shown_part_id(part_id: str) -> str:
    """Return the beginning of an id, valid or not, escaped for a line of text."""
    return escaped(part_id[:_MAX_LENGTH])


def require_given_part_id(part_id: str) -> str:
    """Return an id given with a trigger if it can name a file and is not of a generated form."""
    if not _PART_ID.fullmatch(part_id):
        raise InputError(
            f"part id {part_id[:_MAX_LENGTH]!r}: give 1 to 100 letters, digits, dots, dashes or "
            "underscores, the first a letter or a digit"
        )
    if _DEVICE.fullmatch(part_id):
        raise InputError(f"part id {part_id}: cannot be a file name on Windows; give another one")
    if _GENERATED_ID.fullmatch(part_id):
        raise InputError(
            f"part id {part_id}: the station makes ids of this form itself; give another one"
        )
    return part_id


def require_utc(text: str) -> str:
    """Return a time of the form ``2026-11-22T17:08:13.042Z``; `ValueError` for another one."""
    if not _UTC.fullmatch(text):
        raise ValueError(f"{text!r}: not a time such as 2026-11-22T17:08:13.042Z")
    return text


@dataclass(frozen=True)
class DefectRecord:
    """An outlined defect; box and area in px of the light images, rows downwards."""

    kind: str  # ``relief``, ``albedo`` or ``texture`` of the defect map; ``seam`` or ``window``
    row: int
    column: int
    height: int
    width: int
    area_px: int
    score: float  # largest score in it; 1 is the recipe's threshold


@dataclass(frozen=True)
class PartResult(LimitedMeasures):
    """The result of one part; ValueError for a value that no row can hold, such as NaN."""

    station: str
    part_id: str
    number: int  # in the order of triggers, from 1, without gaps within a station
    trigger: str  # ``timer``, ``enter``, ``sensor``, ``http`` or ``modbus``
    triggered_utc: str  # as in ``2026-11-22T17:08:13.042Z``
    exposed_utc: str | None  # end of the last exposure; None where none was completed
    decided_utc: str
    verdict: Verdict
    operator: str | None
    simulated: bool
    software_version: str
    recipe: str | None = None
    recipe_version: int | None = None
    recipe_sha256: str | None = None
    library_sha256: str | None = None
    calibration_sha256: str | None = None
    set_file: str | None = None  # relative to the station's folder
    set_sha256: str | None = None  # of the pixels
    label: str | None = None  # `label` to `blur_px`: as in `classify.Match`
    nearest: str | None = None
    orientation_deg: float | None = None  # over `orientation_period_deg`
    # 360 where the recipe has ``full_turn`` and the texture shows it, else 180.
    orientation_period_deg: float | None = None
    distance: float | None = None
    limit: float | None = None
    margin: float | None = None
    blur_px: float | None = None
    defects: tuple[DefectRecord, ...] = ()  # largest score first; those of windows last
    # Signal of each light as a share of its taught signal; the albedo scales all of them alike.
    # Their differences are those of the LEDs where the redundancy of the images shows these.
    led_levels: tuple[float, ...] = ()
    timings_ms: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    # Place in the chain of hashes of the station; None before the result is recorded.
    link: int | None = field(default=None, compare=False)
    chain_sha256: str | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        for time in (self.triggered_utc, self.exposed_utc, self.decided_utc):
            if time is not None:
                require_utc(time)
        if not 1 <= self.number <= _MAX_INTEGER or abs(self.recipe_version or 0) > _MAX_INTEGER:
            raise ValueError(
                f"number {self.number} is below 1, or it or recipe version {self.recipe_version} "
                "exceeds 64 bits"
            )
        for name, value in self._measured():
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{name} of part {self.part_id} is {value}")

    @cached_property
    def row(self) -> Mapping[str, Any]:
        """The columns of the table ``results``, which are also those of CSV, JSON and MQTT."""
        values = vars(self) | vars(self.verdict)
        return {name: _plain(name, values[name]) for name in COLUMNS}

    def _measured(self) -> Iterator[tuple[str, float | None]]:
        yield from ((name, getattr(self, name)) for name in MEASURES)
        for defect in self.defects:
            yield from (("defects", value) for value in astuple(defect)[1:])
        yield from (("led_levels", level) for level in self.led_levels)
        yield from self.timings_ms.items()


def _columns() -> dict[str, Any]:
    hints = get_type_hints(PartResult)
    columns: dict[str, Any] = {}
    for name in PartResult.__annotations__:
        columns |= get_type_hints(Verdict) if name == "verdict" else {name: hints[name]}
        if name == "blur_px":  # the measures with limits follow those of the match
            columns |= {field.name: float | None for field in fields(LimitedMeasures)}
    return columns


COLUMNS = _columns()
"""The columns of a result with their types: of table, CSV, JSON and MQTT."""


def _plain(name: str, value: Any) -> Any:
    """Return a value of a column as database and JSON hold it."""
    if name in MEASURES and value is not None:
        return float(value) + 0.0  # SQLite makes 0.0 of -0.0
    match value:
        case StrEnum():
            return value.value
        case str():
            return storable(value)
        case tuple():
            return [_plain(name, element) for element in value]
        case DefectRecord():
            return asdict(value)
        case Mapping():
            return {key: float(number) for key, number in value.items()}
        case _:
            return float(value) if isinstance(value, float) else value


def storable(text: str) -> str:
    """Return text that every database holds: surrogates and NUL escaped, at most `MAX_TEXT`."""
    escaped = text.encode("utf-8", "backslashreplace").decode("utf-8").replace("\0", "\\x00")
    return escaped if len(escaped) <= MAX_TEXT else f"{escaped[: MAX_TEXT - 1]}…"


def result_of(row: Mapping[str, Any]) -> PartResult:
    """Return the result of a row of the table ``results``."""
    values = dict(row)
    verdict = Verdict(
        Decision(values.pop("decision")),
        values.pop("reason"),
        tuple(map(Cause.named, values.pop("causes"))),
    )
    values["defects"] = tuple(DefectRecord(**defect) for defect in values["defects"])
    values |= {name: tuple(values[name]) for name in ("led_levels", "notes")}
    return PartResult(verdict=verdict, **values)
