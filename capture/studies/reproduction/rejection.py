"""Exhibits of unknown textures: share of them that is accepted as a known class."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from classify import Match

from . import plots
from .exhibit import Exhibit, Row
from .plan import OURS, THESIS
from .results import Results
from .runs import Outcome

__all__ = ["ScorePair", "accepted_pct", "rejection_curve", "rejection_exhibits"]

_TITLES = {OURS: "joint distance over the limit of the class", THESIS: "2D spectra of the thesis"}
# Share of known tests that the limit of the table rejects.
_REJECTED = 0.01
# The CSV of the curves ends here: a rig that rejects more of its own classes is of no use.
_LISTED_PCT = 20.0

Groups = Mapping[str, Mapping[str, Sequence[Outcome]]]


class ScorePair(NamedTuple):
    """Score of a test with and without its class in the library; higher is less known.

    The score is the distance to the nearest class over the limit of that class, or the distance
    where the classifier has no limits.
    """

    known: float
    unknown: float


def rejection_exhibits(results: Results) -> Iterator[Exhibit]:
    """The table at 1 % false rejection, and the curves of both scores."""
    groups = _groups(results)
    if groups:
        yield _table(groups)
        yield _curves(groups)


def accepted_pct(pairs: Sequence[ScorePair], rejected: float) -> float:
    """Percent of unknown accepted when the limit rejects at most the share `rejected` of known."""
    known = np.sort([pair.known for pair in pairs])
    kept = math.ceil((1.0 - rejected) * len(known) - 1e-9)
    limit = known[max(kept, 1) - 1]
    return 100.0 * float(np.mean([pair.unknown <= limit for pair in pairs]))


def rejection_curve(pairs: Sequence[ScorePair]) -> tuple[list[float], list[float]]:
    """Known rejected and unknown accepted, in percent, for every limit."""
    known = np.sort([pair.known for pair in pairs])[::-1]
    unknown = np.sort([pair.unknown for pair in pairs])
    accepted = np.searchsorted(unknown, known, side="right") / len(unknown)
    rejected = np.arange(len(known)) / len(known)
    return (100.0 * rejected).tolist(), (100.0 * accepted).tolist()


def _groups(results: Results) -> Groups:
    """Outcomes on disjoint patches by test run and classifier."""
    groups: dict[str, dict[str, list[Outcome]]] = {}
    for system, outcomes in results.outcomes.items():
        asked = [each for each in outcomes if each.match_without_class is not None]
        if asked and system.protocol == "disjoint":
            name = "materials" if system.experiment == "materials" else system.test
            groups.setdefault(name, {})[system.classifier] = asked
    return groups


def _pairs(outcomes: Sequence[Outcome]) -> list[ScorePair]:
    return [
        ScorePair(_score(each.trial.match), _score(each.match_without_class))
        for each in outcomes
        if each.match_without_class is not None
    ]


def _score(match: Match) -> float:
    return match.distance / (match.limit or 1.0)


def _with_trained_limits(outcomes: Sequence[Outcome]) -> tuple[float, float]:
    """Known rejected and unknown accepted, in percent, by the limits in the library."""
    rejected = [each.trial.match.label is None for each in outcomes]
    accepted = [
        each.match_without_class is not None and each.match_without_class.label is not None
        for each in outcomes
    ]
    return 100.0 * float(np.mean(rejected)), 100.0 * float(np.mean(accepted))


def _table(groups: Groups) -> Exhibit:
    rows: list[Row] = [
        (title, *(accepted_pct(_pairs(tests[name]), _REJECTED) for tests in groups.values()))
        for name, title in _TITLES.items()
    ]
    trained = [_with_trained_limits(tests[OURS]) for tests in groups.values()]
    rows.append(("limits from training: known rejected", *(known for known, _ in trained)))
    rows.append(("limits from training: unknown accepted", *(unknown for _, unknown in trained)))
    return Exhibit(
        "unknown",
        ("score", *(f"{name}, %" for name in groups)),
        rows,
        values={
            "counts": ", ".join(f"{name} {len(tests[OURS])}" for name, tests in groups.items())
        },
    )


def _curves(groups: Groups) -> Exhibit:
    rows: list[Row] = []
    panels = []
    for name, tests in groups.items():
        lines = []
        for classifier, title in _TITLES.items():
            rejected, accepted = rejection_curve(_pairs(tests[classifier]))
            lines.append(plots.Line(title, rejected, accepted, style="-"))
            points = zip(rejected, accepted, strict=True)
            rows += [(name, classifier, x, y) for x, y in points if x <= _LISTED_PCT]
        x, y = _with_trained_limits(tests[OURS])
        rows.append((name, "limits from training", x, y))
        lines.append(plots.Line("limits from training", [x], [y], style="*", colour="#000000"))
        panels.append((name, lines))
    return Exhibit(
        "unknown_curves",
        ("tests", "score", "known_rejected_pct", "unknown_accepted_pct"),
        rows,
        draw=partial(
            plots.draw_lines,
            panels=panels,
            log_x=True,
            x_label="known rejected, %",
            y_label="unknown accepted, %",
        ),
        size_in=(13.0, 4.2),
    )
