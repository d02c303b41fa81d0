"""Answers, counted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from .exams import Answer
from .plan import OURS

__all__ = ["DIRECTIONAL_SHARPNESS", "Tally", "percent", "quantile"]

DIRECTIONAL_SHARPNESS = 0.5
"""A match whose `sharpness` is above this has a direction to speak of."""

System = tuple[str, str, str, str, str]


class Tally:
    """All answers of a reproduction by experiment, exam, protocol, solver and classifier."""

    def __init__(self, answers: Iterable[Answer]) -> None:
        self._answers: dict[System, list[Answer]] = {}
        for answer in answers:
            self._answers.setdefault(answer[:5], []).append(answer)

    @property
    def count(self) -> int:
        """How many answers there are."""
        return sum(map(len, self._answers.values()))

    def answers(
        self,
        experiment: str,
        exam: str,
        solver: str,
        classifier: str,
        protocol: str = "disjoint",
    ) -> list[Answer]:
        """Those of one system; empty where it was not asked."""
        return self._answers.get((experiment, exam, protocol, solver, classifier), [])

    def accuracy(
        self,
        experiment: str,
        exam: str,
        solver: str,
        classifier: str,
        protocol: str = "disjoint",
        texture: str | None = None,
    ) -> float | None:
        """Percent of tests whose nearest class is the true one, of all textures or of one.

        Unknown is not counted as an answer here: every test gets its nearest class.
        """
        answers = self.answers(experiment, exam, solver, classifier, protocol)
        return percent(answer.right for answer in answers if texture in (None, answer.texture))

    def rejected(self, experiment: str, exam: str, solver: str, protocol: str) -> float | None:
        """Percent of tests that our classifier calls unknown."""
        answers = self.answers(experiment, exam, solver, OURS, protocol)
        return percent(answer.rejected for answer in answers)

    def orientation_errors_deg(
        self,
        experiment: str,
        exam: str,
        solver: str,
        classifier: str,
        protocol: str = "disjoint",
    ) -> list[float]:
        """Of the right answers of a classifier, on tests in which ours sees a direction."""
        ours = self.answers(experiment, exam, solver, OURS, protocol)
        asked = self.answers(experiment, exam, solver, classifier, protocol)
        return [
            abs((answer.found_deg - answer.turn_deg + 90.0) % 180.0 - 90.0)
            for judge, answer in zip(ours, asked, strict=True)
            if judge.right and (judge.sharpness or 0.0) > DIRECTIONAL_SHARPNESS
            if answer.right and answer.found_deg is not None
        ]


def percent(outcomes: Iterable[bool]) -> float | None:
    """Share of the true ones, in percent; None without any outcome."""
    counted = list(outcomes)
    return 100.0 * sum(counted) / len(counted) if counted else None


def quantile(values: Sequence[float], share: float) -> float | None:
    """None without values."""
    return float(np.quantile(values, share)) if values else None
