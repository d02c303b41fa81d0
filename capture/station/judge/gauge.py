"""Attribute gauge study: verdicts on known parts, each presented several times; its report."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Literal, Self

from pydantic import Field

from capture.base.utc_time import utc_text
from capture.station.domain.recipe import Sha256
from capture.station.domain.verdict import Decision, Verdict
from classify.base.errors import InputError
from classify.base.models import Record
from classify.base.regular_file import read_regular_file
from classify.confidence import CONFIDENCE, share_at_least, share_at_most, trials_to_show

_Rating = Literal["acceptable", "marginal", "unacceptable"]
# Smallest effectiveness, and largest shares of misses and of false alarms, of an acceptable and of
# a marginal gauge (AIAG, Measurement Systems Analysis, 4th edition, chapter III C).
ACCEPTABLE = (0.90, 0.02, 0.05)
_MARGINAL = (0.80, 0.05, 0.10)
_RATINGS: tuple[tuple[_Rating, tuple[float, float, float]], ...] = (
    ("acceptable", ACCEPTABLE),
    ("marginal", _MARGINAL),
)
_TRUTHS = {"good": True, "bad": False}
# Number of parts with a wrong verdict that a report names.
_MAX_WRONG_ROWS = 200
_MAX_BYTES = 1 << 22  # the reasons of 200 parts, of up to 2,000 characters each, have 0.4 MB


@dataclass(frozen=True)
class Presentation:
    """One presentation of a known part, and the verdict on it with its reason."""

    part: str
    is_good: bool
    decision: Decision
    reason: str

    @property
    def is_right(self) -> bool:
        """Whether a good part passed, or a bad one did not."""
        return self.is_good == (self.decision is Decision.PASS)


_Part = list[Presentation]
"""All presentations of a part."""


class Share(Record):
    """A share of trials with its exact upper or lower bound at 95 % confidence."""

    events: int
    trials: int
    share: float | None  # None without trials
    bound: float

    @classmethod
    def of(cls, events: int, trials: int, bound: float) -> Self:
        """Return the share of `events` in `trials`, None without trials."""
        share = events / trials if trials else None
        return cls(events=events, trials=trials, share=share, bound=bound)

    def text(self, side: Literal["at least", "at most"]) -> str:
        """Return the share and its bound, as text."""
        if self.share is None:
            return "no trials"
        return f"{self.events} of {self.trials}, {self.share:.1%}; {side} {self.bound:.1%}"


def read_known_parts(path: Path) -> dict[str, bool]:
    """Read a CSV file of known parts: a line ``ID,good`` or ``ID,bad`` for each."""
    try:
        text = read_regular_file(path, _MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text; save it as CSV in UTF-8") from error
    known: dict[str, bool] = {}
    try:
        rows = list(csv.reader(io.StringIO(text)))
    except csv.Error as error:
        raise InputError(f"{path}: not CSV ({error})") from error
    for number, row in enumerate(rows, 1):
        cells = [cell.strip() for cell in row]
        if not any(cells):
            continue
        truth = _TRUTHS.get(cells[-1].casefold())
        if len(cells) != 2 or truth is None or not cells[0]:
            line = ",".join(row)
            raise InputError(f"{path}: line {number}: give ID,good or ID,bad, not {line!r}")
        if known.setdefault(cells[0], truth) != truth:
            raise InputError(f"{path}: line {number}: {cells[0]} is good and bad")
    if not known:
        raise InputError(f"{path}: names no part; give lines such as K07,good")
    return known


def presentations_of(
    known: dict[str, bool], recorded: Iterable[tuple[str, Verdict]]
) -> Sequence[Presentation]:
    """Return presentations of known parts among recorded verdicts.

    The id of a presentation is that of the part, or one such as ``K07-2`` of part ``K07``.
    """
    presentations = []
    for part_id, verdict in recorded:
        name = part_id if part_id in known else part_id.rpartition("-")[0]
        if name in known:
            presentations.append(Presentation(name, known[name], verdict.decision, verdict.reason))
    return presentations


class GaugeReport(Record):
    """The report of a gauge study."""

    format: Literal["ps4rig-gauge"] = "ps4rig-gauge"
    version: Literal[1] = 1
    utc: str = Field(default_factory=utc_text)  # end of the study
    software_version: str = Field(default_factory=lambda: version("ps4rig"))
    recipe: str
    recipe_sha256: Sha256 | None  # None for results of an earlier run
    simulated: bool
    presentations: int
    effectiveness: Share  # of the parts: the right verdict every time
    misses: Share  # of the presentations of bad parts: passed
    false_alarms: Share  # of the presentations of good parts: did not pass
    rating: _Rating  # by AIAG; unacceptable without good parts or without bad parts
    lines: tuple[str, ...]  # one finding per line; the last ones of a `FaultStudy`
    wrong: tuple[str, ...]  # first parts with a wrong verdict: how often, and the first reason

    @classmethod
    def of(
        cls,
        presentations: Sequence[Presentation],
        recipe: str,
        recipe_sha256: str | None,
        *,
        simulated: bool,
        faults: Sequence[str] = (),
    ) -> Self:
        """Return the report of a study that has just ended; `faults` are lines of a FaultStudy."""
        by_part: dict[str, _Part] = {}
        for presentation in presentations:
            by_part.setdefault(presentation.part, []).append(presentation)
        good_parts = [part for part in by_part.values() if part[0].is_good]
        bad_parts = [part for part in by_part.values() if not part[0].is_good]
        parts, bad = len(by_part), len(bad_parts)
        right = sum(_wrong_count(part) == 0 for part in by_part.values())
        effectiveness = Share.of(right, parts, share_at_least(right, parts))
        misses, false_alarms = _wrong_share(bad_parts), _wrong_share(good_parts)
        rating = _rating(effectiveness.share, misses.share, false_alarms.share)
        min_effectiveness, max_misses, max_false_alarms = ACCEPTABLE
        right_text = effectiveness.text("at least")
        missed_text, alarms_text = misses.text("at most"), false_alarms.text("at most")
        lines = [
            f"{parts} known parts, {bad} of them bad, {len(presentations)} presentations",
            f"effectiveness: {right_text}; acceptable is {min_effectiveness:.0%} or more",
            f"misses: {missed_text}; acceptable is {max_misses:.0%} or less",
            f"false alarms: {alarms_text}; acceptable is {max_false_alarms:.0%} or less",
            f"this gauge is {rating}; bounds count parts, with {CONFIDENCE:.0%} confidence",
        ]
        needed = trials_to_show(max_misses)
        if misses.events == 0 and bad < needed:
            lines.append(
                f"{bad} bad parts without a miss do not show {max_misses:.0%}: that takes {needed}"
            )
        return cls(
            recipe=recipe,
            recipe_sha256=recipe_sha256,
            simulated=simulated,
            presentations=len(presentations),
            effectiveness=effectiveness,
            misses=misses,
            false_alarms=false_alarms,
            rating=rating,
            lines=(*lines, *faults),
            wrong=tuple(islice(_wrong_lines(by_part.values()), _MAX_WRONG_ROWS)),
        )


def _wrong_count(part: _Part) -> int:
    return sum(not presentation.is_right for presentation in part)


def _wrong_share(parts: Sequence[_Part]) -> Share:
    """Share of the presentations with a wrong verdict; its bound counts parts."""
    wrong = [_wrong_count(part) for part in parts]
    bound = share_at_most(sum(count > 0 for count in wrong), len(parts))
    return Share.of(sum(wrong), sum(map(len, parts)), bound)


def _rating(
    effectiveness: float | None, misses: float | None, false_alarms: float | None
) -> _Rating:
    if effectiveness is None or misses is None or false_alarms is None:
        return "unacceptable"
    for rating, (min_effectiveness, max_misses, max_alarms) in _RATINGS:
        is_effective = effectiveness >= min_effectiveness
        if is_effective and misses <= max_misses and false_alarms <= max_alarms:
            return rating
    return "unacceptable"


def _wrong_lines(parts: Iterable[_Part]) -> Iterator[str]:
    for part in parts:
        wrong = [presentation for presentation in part if not presentation.is_right]
        if wrong:
            kind, first = "good" if wrong[0].is_good else "bad", wrong[0]
            counts = f"{len(wrong)} of {len(part)} times wrong"
            yield f"{first.part}, {kind}, {counts}: {first.decision}, {first.reason}"


def read_gauge_report(path: Path) -> GaugeReport | None:
    """Read the report of a recipe; None if no study was made."""
    if not path.exists():
        return None
    return GaugeReport.read(path, _MAX_BYTES, "run ps4rig station gauge")
