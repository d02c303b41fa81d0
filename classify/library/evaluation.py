"""How often a library is right, and by how many degrees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from classify.errors import InputError

from .match import Match

__all__ = ["ClassResult", "Evaluation", "OrientationError", "Trial", "evaluate"]


@dataclass(frozen=True)
class Trial:
    """One test: the true class, the true orientation where it is known, and the answer."""

    label: str
    orientation_deg: float | None
    match: Match

    @property
    def orientation_error_deg(self) -> float | None:
        """Error modulo half a turn, 0 to 90; None where unknown or the class is wrong."""
        found_deg = self.match.orientation_deg
        if self.orientation_deg is None or found_deg is None or self.match.label != self.label:
            return None
        difference = found_deg - self.orientation_deg
        return abs((difference + 90.0) % 180.0 - 90.0)

    @property
    def is_reversed(self) -> bool | None:
        """Whether the heading is the wrong way round; None where none was told or is known."""
        found_deg = self.match.heading_deg
        if self.orientation_deg is None or found_deg is None or self.match.label != self.label:
            return None
        return abs((found_deg - self.orientation_deg + 180.0) % 360.0 - 180.0) > 90.0


@dataclass(frozen=True)
class OrientationError:
    """Median and 95th percentile of the orientation errors, degrees; None without any."""

    median: float | None
    p95: float | None

    @classmethod
    def of(cls, trials: Sequence[Trial]) -> OrientationError:
        """Over the trials with the right class and a known orientation."""
        errors = [e for trial in trials if (e := trial.orientation_error_deg) is not None]
        if not errors:
            return cls(None, None)
        return cls(float(np.median(errors)), float(np.percentile(errors, 95)))


@dataclass(frozen=True)
class ClassResult:
    """Results of the trials of one true class."""

    sets: int
    correct: int
    orientation_error_deg: OrientationError

    @property
    def accuracy(self) -> float:
        """Share of right answers."""
        return self.correct / self.sets


@dataclass(frozen=True)
class Evaluation:
    """Results over all trials.

    `confusion[true][answered]` counts sets; the answer of an unknown is ``None``. Of the sets with
    the right class and a known orientation, `headings` were told a heading too, and `reversed`
    of these the wrong one.
    """

    sets: int
    correct: int
    unknown: int
    per_class: dict[str, ClassResult]
    confusion: dict[str, dict[str | None, int]]
    orientation_error_deg: OrientationError
    headings: int
    reversed: int

    @property
    def accuracy(self) -> float:
        """Share of right answers; unknown counts as wrong."""
        return self.correct / self.sets


def evaluate(trials: Sequence[Trial]) -> Evaluation:
    """Summarise trials.

    Raises
    ------
    InputError
        Without trials.
    """
    if not trials:
        raise InputError("nothing to evaluate; give at least one labelled set")
    by_class: dict[str, list[Trial]] = {}
    confusion: dict[str, dict[str | None, int]] = {}
    for trial in trials:
        by_class.setdefault(trial.label, []).append(trial)
        row = confusion.setdefault(trial.label, {})
        row[trial.match.label] = row.get(trial.match.label, 0) + 1
    per_class = {
        label: ClassResult(
            sets=len(group),
            correct=sum(trial.match.label == label for trial in group),
            orientation_error_deg=OrientationError.of(group),
        )
        for label, group in sorted(by_class.items())
    }
    told = [trial.is_reversed for trial in trials if trial.is_reversed is not None]
    return Evaluation(
        sets=len(trials),
        correct=sum(result.correct for result in per_class.values()),
        unknown=sum(trial.match.label is None for trial in trials),
        per_class=per_class,
        confusion=confusion,
        orientation_error_deg=OrientationError.of(trials),
        headings=len(told),
        reversed=sum(told),
    )
