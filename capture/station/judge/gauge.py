"""Attribute gauge study: verdicts on known parts, each presented several times; its report."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
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


class Share(Record):
    """A share of trials with its exact upper or lower bound at 95 % confidence."""

    events: int
    trials: int
    share: float | None  # None without trials
    bound: float
    bound_is_upper: bool = Field(default=True, exclude=True)

    @classmethod
    def of(cls, events: int, trials: int, bound: float, *, bound_is_upper: bool = True) -> Self:
        """Return the share of `events` in `trials`, None without trials."""
        share = events / trials if trials else None
        return cls(
            events=events, trials=trials, share=share, bound=bound, bound_is_upper=bound_is_upper
        )

    def __str__(self) -> str:
        if self.share is None:
            return "no trials"
        side = "at most" if self.bound_is_upper else "at least"
        return f"{self.events} of {self.trials}, {self.share:.1%}; {side} {self.bound:.1%}"


@dataclass(frozen=True)
class GaugeStudy:
    """The outcome of a study."""

    presentations: tuple[Presentation, ...]

    @property
    def effectiveness(self) -> Share:
        """Share of the parts with the right verdict every time."""
        wrong_count, parts = len(self._wrong_parts()), len(self._parts())
        right = parts - wrong_count
        return Share.of(right, parts, share_at_least(right, parts), bound_is_upper=False)

    @property
    def misses(self) -> Share:
        """Share of the presentations of bad parts that passed."""
        return self._wrong_of(is_good=False)

    @property
    def false_alarms(self) -> Share:
        """Share of the presentations of good parts that did not pass."""
        return self._wrong_of(is_good=True)

    @property
    def rating(self) -> _Rating:
        """The rating by AIAG; unacceptable without good parts or without bad parts."""
        shares = (self.effectiveness.share, self.misses.share, self.false_alarms.share)
        if any(share is None for share in shares):
            return "unacceptable"
        effectiveness, misses, false_alarms = (share or 0.0 for share in shares)
        for rating, (min_effectiveness, max_misses, max_alarms) in _RATINGS:
            is_effective = effectiveness >= min_effectiveness
            if is_effective and misses <= max_misses and false_alarms <= max_alarms:
                return rating
        return "unacceptable"

    def lines(self) -> list[str]:
        """Return the report, one finding per line."""
        parts = self._parts()
        bad = sum(not is_good for is_good in parts.values())
        min_effectiveness, max_misses, max_false_alarms = ACCEPTABLE
        lines = [
            f"{len(parts)} known parts, {bad} of them bad, {len(self.presentations)} presentations",
            f"effectiveness: {self.effectiveness}; acceptable is {min_effectiveness:.0%} or more",
            f"misses: {self.misses}; acceptable is {max_misses:.0%} or less",
            f"false alarms: {self.false_alarms}; acceptable is {max_false_alarms:.0%} or less",
            f"this gauge is {self.rating}; bounds count parts, with {CONFIDENCE:.0%} confidence",
        ]
        needed = trials_to_show(max_misses)
        if self.misses.events == 0 and bad < needed:
            lines.append(
                f"{bad} bad parts without a miss do not show {max_misses:.0%}: that takes {needed}"
            )
        return lines

    def wrong_verdicts(self) -> list[str]:
        """Return a line for each part with a wrong verdict: how often, and the first reason."""
        lines = []
        for part, is_good in self._wrong_parts().items():
            of_part = [
                presentation for presentation in self.presentations if presentation.part == part
            ]
            wrong_presentations = [
                presentation for presentation in of_part if not presentation.is_right
            ]
            kind, first = "good" if is_good else "bad", wrong_presentations[0]
            counts = f"{len(wrong_presentations)} of {len(of_part)} times wrong"
            lines.append(f"{part}, {kind}, {counts}: {first.decision}, {first.reason}")
        return lines

    def _parts(self) -> dict[str, bool]:
        return {presentation.part: presentation.is_good for presentation in self.presentations}

    def _wrong_parts(self) -> dict[str, bool]:
        return {
            presentation.part: presentation.is_good
            for presentation in self.presentations
            if not presentation.is_right
        }

    def _wrong_of(self, *, is_good: bool) -> Share:
        presented = [
            presentation for presentation in self.presentations if presentation.is_good == is_good
        ]
        parts = sum(truth == is_good for truth in self._parts().values())
        wrong_count = sum(truth == is_good for truth in self._wrong_parts().values())
        events = sum(not presentation.is_right for presentation in presented)
        return Share.of(events, len(presented), share_at_most(wrong_count, parts))


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
    utc: str  # end of the study
    software_version: str = Field(default_factory=lambda: version("ps4rig"))
    recipe: str
    recipe_sha256: Sha256 | None  # None for results of an earlier run
    simulated: bool
    presentations: int
    effectiveness: Share  # `effectiveness` to `rating`: as in `GaugeStudy`
    misses: Share
    false_alarms: Share
    rating: _Rating
    lines: tuple[str, ...]  # of `GaugeStudy`, then of `FaultStudy`
    wrong: tuple[str, ...]  # `GaugeStudy.wrong_verdicts`, of the first parts

    @classmethod
    def of(
        cls,
        study: GaugeStudy,
        recipe: str,
        recipe_sha256: str | None,
        *,
        simulated: bool,
        faults: Sequence[str] = (),
    ) -> Self:
        """Return the report of a study that has just ended; `faults` are lines of a FaultStudy."""
        return cls(
            utc=utc_text(timespec="seconds"),
            recipe=recipe,
            recipe_sha256=recipe_sha256,
            simulated=simulated,
            presentations=len(study.presentations),
            effectiveness=study.effectiveness,
            misses=study.misses,
            false_alarms=study.false_alarms,
            rating=study.rating,
            lines=(*study.lines(), *faults),
            wrong=tuple(study.wrong_verdicts()[:_MAX_WRONG_ROWS]),
        )


def read_gauge_report(path: Path) -> GaugeReport | None:
    """Read the report of a recipe; None if no study was made."""
    if not path.exists():
        return None
    return GaugeReport.read(path, _MAX_BYTES, "run ps4rig station gauge")
