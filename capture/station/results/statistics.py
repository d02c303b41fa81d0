"""Figures over many parts, counted by the database: over time, and by cause.

Whatever the number of parts, the answers are bounded, and only counts leave the database.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, tzinfo

from sqlalchemy import ColumnElement, Integer, Text, cast, func, select

from capture.station.domain.verdict import Cause, Decision

from .history import IN_FORCE, IS_COLLECTED, JOINED, Selection, conditions
from .schema import results
from .store import ResultStore

MAX_PERIODS = 400
"""Periods that are counted; the newest ones."""
MAX_MEASURED = 2000
"""Parts of the control charts: 400 points, about as many as a screen shows apart."""
_MAX_CHOICES = 100
"""Names that a form offers; a station knows a few dozen textures."""
# Periods are hours up to a span of two days, days up to three months, and months beyond. A period
# is a prefix of the time: greatest span in days, length of the prefix.
_LENGTHS = ((2.0, len("2026-11-22T17")), (92.0, len("2026-11-22")))
_MONTH = len("2026-11")


@dataclass(frozen=True)
class Period:
    """Numbers of parts of an hour, a day or a month, by the verdict that holds."""

    begin: str  # such as ``2026-11-22T17``, ``2026-11-22`` or ``2026-11``
    verdicts: Mapping[Decision, int]

    @property
    def parts(self) -> int:
        """Number of parts."""
        return sum(self.verdicts.values())


@dataclass(frozen=True)
class ChartedPart:
    """The values of a part for control charts; names as in `PartResult`."""

    number: int
    part_id: str
    triggered_utc: str
    distance: float
    led_levels: Sequence[float]


@dataclass(frozen=True)
class CauseCount:
    """How often a cause kept a part from passing, or a kind of defect was in one."""

    cause: str  # a `Cause`, or the kind of a `DefectRecord`
    parts: int  # of which it is the first; the sum for causes is the number that did not pass
    also: int  # parts that have it beside a graver one


@dataclass(frozen=True)
class Choices:
    """Values by which parts of a station can be selected."""

    labels: tuple[str, ...]
    recipes: tuple[str, ...]


def counted_periods(
    store: ResultStore, selection: Selection, zone: tzinfo | None = None
) -> list[Period]:
    """Count the selected parts that were judged by period of a zone, the earliest first.

    None is the zone of this machine.
    """
    selected = (*conditions(store.station, selection), ~IS_COLLECTED)
    utc = results.c.triggered_utc
    span = select(func.min(utc), func.max(utc)).select_from(JOINED).where(*selected)
    with store.reading() as connection:
        first_utc, last_utc = connection.execute(span).one()
        if first_utc is None:
            return []
        length = _period_length(first_utc, last_utc)
        # Zones differ by quarters of an hour.
        hour = func.substr(utc, 1, len("2026-11-22T17"))
        quarter = cast(func.substr(utc, len("2026-11-22T17:0"), 2), Integer) // 15
        columns = hour.label("hour"), quarter.label("quarter"), IN_FORCE.label("decision")
        counts = (
            select(*columns, func.count().label("parts"))
            .select_from(JOINED)
            .where(*selected)
            .group_by(*columns)
        )
        verdicts: dict[str, Counter[Decision]] = {}
        for row in connection.execute(counts):
            moment = datetime.fromisoformat(f"{row.hour}:{15 * row.quarter:02}Z").astimezone(zone)
            begin = moment.isoformat()[:length]
            verdicts.setdefault(begin, Counter())[Decision(row.decision)] += row.parts
    return [Period(name, verdicts[name]) for name in sorted(verdicts)[-MAX_PERIODS:]]


def _period_length(first_utc: str, last_utc: str) -> int:
    span = datetime.fromisoformat(last_utc) - datetime.fromisoformat(first_utc)
    days = span.total_seconds() / 86_400.0
    return next((length for most, length in _LENGTHS if days <= most), _MONTH)


def counted_causes(store: ResultStore, selection: Selection) -> list[CauseCount]:
    """Count the station's causes of parts that it did not pass, most frequent first.

    They count also where a person changed the verdict. The first cause is the gravest; a part that
    is like no texture counts under its second cause, unless the power of its octaves differs too:
    then it is of another texture.
    """
    # Combinations of causes are few: the database counts parts of each of them.
    causes = cast(results.c.causes, Text)
    statement = (
        select(causes.label("causes"), func.count().label("parts"))
        .select_from(JOINED)
        .where(*conditions(store.station, selection))
        .where(results.c.decision != Decision.PASS.value, ~IS_COLLECTED)
        .group_by(causes)
    )
    first: Counter[Cause] = Counter()
    also: Counter[Cause] = Counter()
    with store.reading() as connection:
        for row in connection.execute(statement):
            gravest, *others = map(Cause.named, json.loads(row.causes))
            if gravest is Cause.NO_TEXTURE and others and Cause.OCTAVES not in others:
                gravest, *others = *others, gravest
            first[gravest] += row.parts
            for cause in others:
                also[cause] += row.parts
    counts = [CauseCount(cause, first[cause], also[cause]) for cause in first.keys() | also.keys()]
    return sorted(counts, key=lambda count: (-count.parts, -count.also, count.cause))


def counted_defects(store: ResultStore, selection: Selection) -> list[CauseCount]:
    """Count parts that did not pass by the kind of their first defect, most frequent first."""
    kind = results.c.defects[0, "kind"].as_string()
    statement = (
        select(kind.label("kind"), func.count().label("parts"))
        .select_from(JOINED)
        .where(*conditions(store.station, selection))
        .where(results.c.decision != Decision.PASS.value, kind.is_not(None))
        .group_by(kind)
    )
    with store.reading() as connection:
        counts = [CauseCount(row.kind, row.parts, 0) for row in connection.execute(statement)]
    return sorted(counts, key=lambda count: (-count.parts, count.cause))


def newest_measured(
    store: ResultStore, selection: Selection, most: int = MAX_MEASURED
) -> list[ChartedPart]:
    """Return the last selected parts that matched a texture, by number."""
    columns = (results.c[name] for name in ChartedPart.__dataclass_fields__)
    statement = (
        select(*columns)
        .select_from(JOINED)
        .where(*conditions(store.station, selection))
        .where(results.c.label.is_not(None), results.c.distance.is_not(None))
        .order_by(results.c.number.desc())
        .limit(most)
    )
    with store.reading() as connection:
        rows = connection.execute(statement).all()
    return [ChartedPart(**row._mapping) for row in reversed(rows)]


def choices(store: ResultStore) -> Choices:
    """Return textures and recipes of all parts, at most `_MAX_CHOICES` of each."""
    return Choices(_names(store, results.c.label), _names(store, results.c.recipe))


def _names(store: ResultStore, column: ColumnElement[str | None]) -> tuple[str, ...]:
    statement = (
        select(column)
        .where(results.c.station == store.station, column.is_not(None))
        .distinct()
        .order_by(column)
        .limit(_MAX_CHOICES)
    )
    with store.reading() as connection:
        return tuple(name for name in connection.scalars(statement) if name is not None)
