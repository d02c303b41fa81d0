"""Counts of parts over time and by cause, which the database makes.

Only counts leave the database, so that an answer is small for any number of parts.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, tzinfo
from typing import Any

from sqlalchemy import Integer, Row, cast, func, select

from capture.station.domain.verdict import Cause, Decision

from .history import COLLECTED, JOINED, Counters, Selection, conditions, counters_of, part_groups
from .schema import results
from .store import ResultStore

MAX_PERIODS = 400
"""Number of newest periods that are counted."""
MAX_MEASURED = 2000
"""Parts of the control charts: 400 points, about as many as a screen can resolve."""
_MAX_NAMES = 100
"""Names that a form offers; a station knows a few dozen textures."""
# A period is a prefix of the time: hours up to a span of two days, days up to three months, and
# months beyond. Each row has the greatest span in days and the length of the prefix.
_PREFIX_LENGTHS = (
    (2.0, len("2026-11-22T17")),
    (92.0, len("2026-11-22")),
    (math.inf, len("2026-11")),
)


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
    parts: int  # whose first cause it is; summed over causes, the number that did not pass
    after_graver: int  # parts that have it after a graver cause


def count_parts(store: ResultStore, selection: Selection) -> tuple[Counters, Sequence[Row[Any]]]:
    """Count the selected parts, and group them by quarter of an hour, verdict and causes."""
    # Each part is read once.
    utc, hour = results.c.triggered_utc, len("2026-11-22T17")
    columns = (
        func.substr(utc, 1, hour).label("hour"),
        # Zones differ by quarters of an hour.
        (cast(func.substr(utc, hour + 2, 2), Integer) // 15).label("quarter"),
    )
    with store.reading() as connection:
        groups = part_groups(connection, store.station, selection, *columns)
        return counters_of(connection, store.station, selection, groups), groups


def counted_periods(groups: Iterable[Row[Any]], zone: tzinfo | None = None) -> list[Period]:
    """Count judged parts by period of a zone (None: that of this machine), the earliest first."""
    verdicts: dict[datetime, Counter[Decision]] = {}  # by quarter of an hour
    for group in groups:
        if group.causes != COLLECTED:
            quarter = datetime.fromisoformat(f"{group.hour}:{15 * group.quarter:02}Z")
            verdicts.setdefault(quarter, Counter())[Decision(group.in_force)] += group.parts
    if not verdicts:
        return []
    days = (max(verdicts) - min(verdicts)).total_seconds() / 86_400.0
    length = next(length for max_days, length in _PREFIX_LENGTHS if days <= max_days)
    periods: dict[str, Counter[Decision]] = {}
    for quarter, counts in verdicts.items():
        periods.setdefault(quarter.astimezone(zone).isoformat()[:length], Counter()).update(counts)
    return [Period(name, periods[name]) for name in sorted(periods)[-MAX_PERIODS:]]


def counted_causes(groups: Iterable[Row[Any]]) -> list[CauseCount]:
    """Count the station's causes of parts that it did not pass, most frequent first."""
    # Overrides do not matter. A part counts under its first cause, which is the gravest. A part
    # without a matching texture counts under its second cause, which says more, unless the power of
    # its octaves differs too: then the part is of another texture.
    parts: Counter[str] = Counter()
    for group in groups:
        if group.decision != Decision.PASS and group.causes != COLLECTED:
            parts[group.causes] += group.parts
    as_first: Counter[Cause] = Counter()
    as_other: Counter[Cause] = Counter()
    for text, count in parts.items():
        gravest, *others = map(Cause.named, json.loads(text))
        if gravest is Cause.NO_TEXTURE and others and Cause.OCTAVES not in others:
            gravest, *others = *others, gravest
        as_first[gravest] += count
        for cause in others:
            as_other[cause] += count
    causes = as_first.keys() | as_other.keys()
    counts = [CauseCount(cause, as_first[cause], as_other[cause]) for cause in causes]
    return sorted(counts, key=lambda count: (-count.parts, -count.after_graver, count.cause))


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
    store: ResultStore, selection: Selection, max_count: int = MAX_MEASURED
) -> list[ChartedPart]:
    """Return the last selected parts that matched a texture, by number."""
    columns = (results.c[name] for name in ChartedPart.__dataclass_fields__)
    statement = (
        select(*columns)
        .select_from(JOINED)
        .where(*conditions(store.station, selection))
        .where(results.c.label.is_not(None), results.c.distance.is_not(None))
        .order_by(results.c.number.desc())
        .limit(max_count)
    )
    with store.reading() as connection:
        rows = connection.execute(statement).all()
    return [ChartedPart(**row._mapping) for row in reversed(rows)]


def known_names(store: ResultStore) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return textures and recipes of all parts, at most `_MAX_NAMES` of each, for a form."""
    names = results.c.label, results.c.recipe
    statement = select(*names).where(results.c.station == store.station).distinct()
    with store.reading() as connection:
        columns = list(zip(*connection.execute(statement), strict=True)) or [(), ()]
    labels, recipes = (
        tuple(sorted({name for name in column if name is not None})[:_MAX_NAMES])
        for column in columns
    )
    return labels, recipes
