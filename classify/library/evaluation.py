"""Accuracy, confusion and orientation errors of a library on labelled sets."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from classify.base.errors import InputError
from classify.classifiers import Observation, classifier_named
from classify.library.texture_library import TextureLibrary
from classify.library.training import TrainingRow
from classify.lighting import orientation_near
from classify.methods import DEFAULT_CLASSIFIER

from .match import Match

# Largest number of folds of `leave_one_out`; of more sets, several are left out together.
_FOLDS = 30


@dataclass(frozen=True)
class Trial:
    """One test: the true class, the true orientation where it is known, and the match."""

    label: str
    orientation_deg: float | None
    match: Match

    @property
    def is_correct(self) -> bool:
        """Whether the match names the true class."""
        return self.match.label == self.label

    @property
    def nearest_is_correct(self) -> bool:
        """Whether the nearest class is the true one, even if it rejects."""
        return self.match.nearest == self.label

    @property
    def orientation_error_deg(self) -> float | None:
        """Error modulo 180, 0 to 90; None where unknown or the class is wrong."""
        return self.nearest_orientation_error_deg if self.is_correct else None

    @property
    def nearest_orientation_error_deg(self) -> float | None:
        """Error modulo 180, 0 to 90; None where unknown or the nearest class is wrong."""
        estimated_deg = self.match.orientation_deg
        if self.orientation_deg is None or estimated_deg is None or not self.nearest_is_correct:
            return None
        return abs(orientation_near(estimated_deg, self.orientation_deg) - self.orientation_deg)

    @property
    def is_reversed(self) -> bool | None:
        """Whether the heading is off by more than 90 degrees; None if not known."""
        estimated_deg = self.match.heading_deg
        if self.orientation_deg is None or estimated_deg is None or not self.is_correct:
            return None
        return abs((estimated_deg - self.orientation_deg + 180.0) % 360.0 - 180.0) > 90.0


def nearest_accuracy(trials: Iterable[Trial]) -> float | None:
    """Share of trials whose nearest class is the true one; None without trials."""
    correct = [trial.nearest_is_correct for trial in trials]
    return sum(correct) / len(correct) if correct else None


@dataclass(frozen=True)
class _OrientationError:
    """Median and 95th percentile of the orientation errors, degrees; None without any."""

    median: float | None
    p95: float | None


@dataclass(frozen=True)
class _ClassResult:
    """Results of the trials of one true class."""

    sets: int
    correct: int
    orientation_error_deg: _OrientationError

    @property
    def accuracy(self) -> float:
        """Share of correct trials."""
        return self.correct / self.sets


@dataclass(frozen=True)
class Evaluation:
    """Results over all trials of taught classes; those of other classes are in `untaught` alone.

    `confusion[true][matched]` counts sets; an unknown surface is matched with ``None``. `untaught`
    counts in the same way. `headings` counts the correct trials with a known orientation and a
    heading, and `reversed` counts those whose heading is off by more than 90 degrees. `blur_px` is
    the median blur relative to the nearest training sets; None where the classifier finds no blur.
    """

    sets: int
    correct: int
    unknown: int
    per_class: dict[str, _ClassResult]
    confusion: dict[str, dict[str | None, int]]
    orientation_error_deg: _OrientationError
    headings: int
    reversed: int
    blur_px: float | None
    untaught: dict[str, dict[str | None, int]]

    @property
    def accuracy(self) -> float | None:
        """Share of correct trials; an unknown one is not correct. None without trials."""
        return self.correct / self.sets if self.sets else None

    @property
    def untaught_rejected(self) -> int:
        """Trials of untaught classes that are rightly unknown."""
        return sum(row.get(None, 0) for row in self.untaught.values())

    @property
    def untaught_accepted(self) -> int:
        """Trials of untaught classes that are wrongly matched with a class."""
        return sum(sum(row.values()) for row in self.untaught.values()) - self.untaught_rejected


def evaluate(trials: Sequence[Trial], classes: Collection[str]) -> Evaluation:
    """Summarise trials of a library with these classes.

    Raises
    ------
    InputError
        Without trials.
    """
    if not trials:
        raise InputError("nothing to evaluate; give at least one labelled set")
    confusion: dict[str, dict[str | None, int]] = {}
    untaught: dict[str, dict[str | None, int]] = {}
    for trial in trials:
        counts = confusion if trial.label in classes else untaught
        row = counts.setdefault(trial.label, {})
        row[trial.match.label] = row.get(trial.match.label, 0) + 1
    trials = [trial for trial in trials if trial.label in classes]
    by_class: dict[str, list[Trial]] = {}
    for trial in trials:
        by_class.setdefault(trial.label, []).append(trial)
    per_class = {
        label: _ClassResult(
            len(group), sum(trial.is_correct for trial in group), _orientation_error(group)
        )
        for label, group in sorted(by_class.items())
    }
    blurs_px = [trial.match.blur_px for trial in trials if trial.match.blur_px is not None]
    reversals = [trial.is_reversed for trial in trials if trial.is_reversed is not None]
    return Evaluation(
        sets=len(trials),
        correct=sum(result.correct for result in per_class.values()),
        unknown=sum(trial.match.label is None for trial in trials),
        per_class=per_class,
        confusion=confusion,
        orientation_error_deg=_orientation_error(trials),
        headings=len(reversals),
        reversed=sum(reversals),
        blur_px=float(np.median(blurs_px)) if blurs_px else None,
        untaught=untaught,
    )


def _orientation_error(trials: Iterable[Trial]) -> _OrientationError:
    """Summarise the errors of the correct trials whose orientation is known."""
    errors_deg = [trial.orientation_error_deg for trial in trials]
    known_deg = [error_deg for error_deg in errors_deg if error_deg is not None]
    if not known_deg:
        return _OrientationError(None, None)
    return _OrientationError(float(np.median(known_deg)), float(np.percentile(known_deg, 95)))


def leave_one_out(
    rows: Sequence[TrainingRow],
    tests: Sequence[Observation],
    segment_px: int,
) -> list[Match | None]:
    """Match of each set with a library trained without its fold; None for a single set."""
    classifier = classifier_named(DEFAULT_CLASSIFIER)
    matches: list[Match | None] = [None] * len(rows)
    # Sets of one class are neighbours in `rows`, so that they come into different folds.
    for fold in range(min(_FOLDS, len(rows))):
        others = [row for number, row in enumerate(rows) if number % _FOLDS != fold]
        if not others:
            continue
        library = TextureLibrary.from_observations(others, segment_px)
        for number in range(fold, len(rows), _FOLDS):
            signature = classifier.signature(tests[number], library.parameters)
            matches[number] = library.match(signature)
    return matches
