"""Select, count and read recorded parts, and write them as CSV and JSON."""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from datetime import UTC, date, datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, Select, Text, case, cast, func, select

from capture.base.outputs import csv_line
from capture.base.utc_time import utc_text
from capture.station.domain.verdict import Cause, Decision
from classify.base.errors import InputError, Ps4rigError

from .chain import Head
from .part_result import COLUMNS as RESULT_COLUMNS
from .part_result import PartResult, result_of, storable
from .schema import overrides, refused_triggers, removed_sets, results, same_part

_MINUTE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d")
_DAY_LENGTH = len("2026-11-22")
PAGE_ROWS = 500  # number of rows that are in memory at a time
_FIRST_COLUMNS = (
    "station", "number", "part_id", "triggered_utc", "verdict", "reason", "causes", "simulated",
    "override", "set_removed_utc", "station_verdict",
)  # fmt: skip
_RENAMED_COLUMN = "decision"  # becomes ``verdict`` and ``station_verdict``
COLUMNS = (
    *_FIRST_COLUMNS,
    *(name for name in RESULT_COLUMNS if name not in (*_FIRST_COLUMNS, _RENAMED_COLUMN)),
)


@dataclass(frozen=True)
class Override:
    """A verdict that a person gave a part; it replaces that of the station."""

    decision: Decision
    by: str
    reason: str
    utc: str


@dataclass(frozen=True)
class HistoryEntry:
    """A recorded part with its last override and the removal of its set file."""

    result: PartResult
    override: Override | None
    set_removed_utc: str | None  # None if it was not removed

    @property
    def decision(self) -> Decision:
        """The verdict that holds: that of the override, or else that of the station."""
        return self.override.decision if self.override else self.result.verdict.decision


@dataclass(frozen=True)
class Selection:
    """A selection of the parts of a station; None selects all."""

    since_utc: str | None = None  # least and greatest time of the trigger
    until_utc: str | None = None
    decision: Decision | None = None  # the verdict in force
    label: str | None = None
    recipe: str | None = None
    simulated: bool | None = None  # False selects production, True parts of a simulated rig
    part_id: str | None = None
    id_contains: str | None = None  # a part of the id, in upper or lower case
    below_number: int | None = None


EVERY_PART = Selection()


def utc_bound(option: str, text: str, *, is_end: bool = False, is_local: bool = False) -> str:
    """Return the time of a bound in ISO 8601, by default UTC without an offset."""
    # `is_end` takes the last millisecond of a date, or of a time in minutes, instead of the first,
    # and the later one of two equal times on the day on which the clock is set back.
    try:
        if len(text) == _DAY_LENGTH:
            text = f"{date.fromisoformat(text)}T{'23:59' if is_end else '00:00'}"
        moment = datetime.fromisoformat(text)
        if moment.tzinfo is None:
            zone = None if is_local else UTC
            moment = moment.replace(tzinfo=zone, fold=int(is_end)).astimezone(UTC)
        if is_end and _MINUTE.fullmatch(text):
            moment += timedelta(minutes=1, milliseconds=-1)
        return utc_text(moment, timespec="milliseconds")
    except (ValueError, OverflowError) as error:
        raise InputError(
            f"{option} {text or repr(text)}: give a date or a time, such as 2026-11-22 or "
            "2026-11-22T14:30"
        ) from error


@dataclass(frozen=True)
class Tally:
    """Numbers of parts, also as JSON."""

    parts: int
    verdicts: Mapping[Decision, int]  # with overrides in place of the station's verdicts
    station_verdicts: Mapping[Decision, int]
    refused_triggers: int
    collected: int  # parts of runs that judge none; not in the other numbers


@dataclass(frozen=True)
class Counters:
    """Numbers of parts of production, and of a simulated rig."""

    production: Tally
    simulated: Tally


_LAST_OVERRIDE = overrides.alias("last")  # of each part
_ANY_OVERRIDE = overrides.alias("again")
_IS_LAST_OVERRIDE = same_part(_LAST_OVERRIDE, results) & (
    _LAST_OVERRIDE.c.position
    == select(func.max(_ANY_OVERRIDE.c.position))
    .where(same_part(_ANY_OVERRIDE, results))
    .scalar_subquery()
)
JOINED = results.outerjoin(_LAST_OVERRIDE, _IS_LAST_OVERRIDE)
"""The results, each with its last override."""
COLLECTED = json.dumps([Cause.COLLECTED])
"""The causes of a part that was collected for teaching: yields do not count it."""
_IN_FORCE = func.coalesce(_LAST_OVERRIDE.c.decision, results.c.decision)  # the verdict that holds


def entries(
    reading: Callable[[], AbstractContextManager[Connection]],
    station: str,
    selection: Selection,
    newest: int | None,
) -> Iterator[HistoryEntry]:
    """Yield parts by number, each page in its own transaction.

    SQLite cannot reset its write-ahead log during a transaction, which a slow reader would hold.
    """
    if newest is not None:
        with reading() as connection:
            page = _page(connection, _selected(station, selection), newest, is_newest=True)
        yield from reversed(page)
        return
    with reading() as connection:
        numbers = select(func.max(results.c.number)).where(results.c.station == station)
        last = connection.scalar(numbers) or 0
    selected = _selected(station, selection).where(results.c.number <= last)
    last_number = 0
    while True:
        with reading() as connection:
            page = _page(connection, selected.where(results.c.number > last_number), PAGE_ROWS)
        yield from page
        if len(page) < PAGE_ROWS:
            return
        last_number = page[-1].result.number


def _selected(station: str, selection: Selection) -> Select[Any]:
    names = ("decision", "by", "reason", "utc")
    override = [_LAST_OVERRIDE.c[name].label(f"override_{name}") for name in names]
    joined = JOINED.outerjoin(removed_sets, same_part(removed_sets, results))
    return (
        select(results, *override, removed_sets.c.utc.label("set_removed_utc"))
        .select_from(joined)
        .where(*conditions(station, selection))
    )


def _page(
    connection: Connection, selected: Select[Any], count: int, *, is_newest: bool = False
) -> list[HistoryEntry]:
    """Return the first selected parts by number, or the last ones, the newest first."""
    order = results.c.number.desc() if is_newest else results.c.number
    rows = connection.execute(selected.order_by(order).limit(count))
    try:
        return [_entry(dict(row)) for row in rows.mappings()]
    except (TypeError, ValueError) as error:
        raise Ps4rigError(
            f"somebody altered the results ({error}); ps4rig verify names the rows"
        ) from error


def part_groups(
    connection: Connection, station: str, selection: Selection, *more_columns: ColumnElement[Any]
) -> Sequence[Row[Any]]:
    """Count the selected parts by verdict; with `more_columns` also by these and by causes."""
    causes: ColumnElement[str] = cast(results.c.causes, Text)
    if not more_columns:  # a short text is compared in less time
        causes = case((causes == COLLECTED, causes), else_="")
    columns = (
        *more_columns,
        results.c.simulated,
        results.c.decision,
        _IN_FORCE.label("in_force"),
        causes.label("causes"),
    )
    statement: Select[Any] = (
        select(*columns, func.count().label("parts"))
        .select_from(JOINED)
        .where(*conditions(station, selection))
        .group_by(*columns)
    )
    return connection.execute(statement).all()


def counters_of(
    connection: Connection, station: str, selection: Selection, groups: Sequence[Row[Any]]
) -> Counters:
    """Return the numbers of parts of all groups, and of refused triggers."""
    station_verdicts: dict[bool, Counter[Decision]] = {False: Counter(), True: Counter()}
    verdicts: dict[bool, Counter[Decision]] = {False: Counter(), True: Counter()}
    collected: Counter[bool] = Counter()
    for group in groups:
        if group.causes == COLLECTED:
            collected[group.simulated] += group.parts
            continue
        station_verdicts[group.simulated][Decision(group.decision)] += group.parts
        verdicts[group.simulated][Decision(group.in_force)] += group.parts
    refused = _refused(connection, station, selection)
    production, simulated = (
        Tally(
            verdicts[simulated].total(),
            verdicts[simulated],
            station_verdicts[simulated],
            refused.get(simulated, 0),
            collected[simulated],
        )
        for simulated in (False, True)
    )
    return Counters(production, simulated)


def _refused(connection: Connection, station: str, selection: Selection) -> dict[bool, int]:
    """Count refused triggers within the times; other criteria do not apply to them."""
    simulated = refused_triggers.c.simulated
    statement = (
        select(simulated, func.count())
        .where(refused_triggers.c.station == station)
        .where(*_time_conditions(refused_triggers.c.utc, selection))
        .group_by(simulated)
    )
    return {row[0]: row[1] for row in connection.execute(statement)}


def conditions(station: str, selection: Selection) -> Iterator[ColumnElement[bool]]:
    """Yield the conditions of the selected rows of `JOINED`."""
    yield results.c.station == station
    yield from _time_conditions(results.c.triggered_utc, selection)
    for column, value in (
        (_IN_FORCE, selection.decision and selection.decision.value),
        (results.c.label, selection.label),
        (results.c.recipe, selection.recipe),
        (results.c.simulated, selection.simulated),
        (results.c.part_id, selection.part_id),
    ):
        if value is not None:
            # An id with invalid characters matches no row.
            yield column == (storable(value) if isinstance(value, str) else value)
    if selection.id_contains is not None:
        text = storable(selection.id_contains)
        yield results.c.part_id.icontains(text, autoescape=True)
    if selection.below_number is not None:
        yield results.c.number < selection.below_number


def _time_conditions(
    utc: ColumnElement[str], selection: Selection
) -> Iterator[ColumnElement[bool]]:
    if selection.since_utc is not None:
        yield utc >= selection.since_utc
    if selection.until_utc is not None:
        yield utc <= selection.until_utc


def _entry(row: dict[str, Any]) -> HistoryEntry:
    removed_utc = row.pop("set_removed_utc")
    decision, by, reason, utc = (
        row.pop(f"override_{name}") for name in ("decision", "by", "reason", "utc")
    )
    override = None if decision is None else Override(Decision(decision), by, reason, utc)
    return HistoryEntry(result_of(row), override, removed_utc)


def record_of(entry: HistoryEntry) -> dict[str, Any]:
    """Return the columns of a part's result, with its override and removed set.

    ``verdict`` is the one in force, after overrides; ``station_verdict`` is the station's own.
    """
    row = entry.result.row
    record = {
        **row,
        "verdict": entry.decision.value,
        "station_verdict": row["decision"],
        "override": None if entry.override is None else asdict(entry.override),
        "set_removed_utc": entry.set_removed_utc,
    }
    return {name: record[name] for name in COLUMNS}


def csv_pieces(entries: Iterable[HistoryEntry]) -> Iterator[str]:
    """Yield a line of CSV (RFC 4180) for each part; lists and objects are JSON in their cell."""
    yield csv_line(COLUMNS)
    for entry in entries:
        yield csv_line(map(_cell, record_of(entry).values()))


def json_pieces(
    station: str, counters: Counters, chain: Head, entries: Iterable[HistoryEntry]
) -> Iterator[str]:
    """Yield the JSON of a history in pieces, so that it is never in memory as a whole."""
    head = {"station": station, **counts_of(counters), **vars(chain)}
    yield json.dumps(head)[:-1] + ', "parts": ['
    for position, entry in enumerate(entries):
        yield (",\n" if position else "\n") + json.dumps(record_of(entry), allow_nan=False)
    yield "\n]}\n"


def counts_of(counters: Counters) -> dict[str, Any]:
    """Return numbers of parts for JSON; those of a simulated rig are separate."""
    return {name: vars(tally) for name, tally in vars(counters).items()}


def _cell(value: Any) -> Any:
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict) else value
