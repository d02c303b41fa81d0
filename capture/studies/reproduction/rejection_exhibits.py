"""Exhibits of what was never learned: how much of it is taken for something known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from . import plots
from .exams import Rejection
from .exhibit import Cell, Exhibit, Row, exhibit
from .plan import BEST_SOLVER
from .reference import NOTES_REJECTION
from .rejection import SCORES, ScorePair
from .results import Results
from .tally import percent

__all__ = ["accepted_at", "rejection_curve", "rejection_exhibits"]

_REJECTED = 0.01
_LISTED_PCT = 20.0


def rejection_exhibits(results: Results) -> Iterator[Exhibit]:
    """The table at 1 % false rejection, and a curve for each score."""
    groups = _groups(results.rejections)
    if groups:
        yield _table(groups)
        yield _curves(groups)


def accepted_at(pairs: Sequence[ScorePair], rejected: float) -> float:
    """Share of unknown accepted where at most the share `rejected` of the known is refused."""
    known = np.sort([pair.known for pair in pairs])
    kept = math.ceil((1.0 - rejected) * len(known) - 1e-9)
    limit = known[max(kept, 1) - 1]
    return float(np.mean([pair.unknown <= limit for pair in pairs]))


def rejection_curve(pairs: Sequence[ScorePair]) -> tuple[list[float], list[float]]:
    """False rejection and acceptance of the unknown, in percent, for every limit."""
    known = np.sort([pair.known for pair in pairs])[::-1]
    unknown = np.sort([pair.unknown for pair in pairs])
    accepted = np.searchsorted(unknown, known, side="right") / len(unknown)
    rejected = np.arange(len(known)) / len(known)
    return (100.0 * rejected).tolist(), (100.0 * accepted).tolist()


def _groups(rejections: Sequence[Rejection]) -> dict[str, list[Rejection]]:
    """By what is tested; materials on disjoint patches only."""
    groups: dict[str, list[Rejection]] = {}
    for each in rejections:
        if each.protocol == "disjoint":
            name = "materials" if each.experiment == "materials" else each.exam
            groups.setdefault(name, []).append(each)
    return groups


def _table(groups: dict[str, list[Rejection]]) -> Exhibit:
    rows: list[Row] = []
    for score, title in SCORES.items():
        noted = NOTES_REJECTION.get(score, {})
        cells: list[Cell] = []
        for name, tests in groups.items():
            pairs = [each.pairs[score] for each in tests]
            cells += [100.0 * accepted_at(pairs, _REJECTED), noted.get(name)]
        rows.append((title, *cells))
    shipped = {name: _shipped(tests) for name, tests in groups.items()}
    for index, title in enumerate(("shipped limits: known rejected", "unknown accepted")):
        cells = [cell for point in shipped.values() for cell in (point[index], None)]
        rows.append((title, *cells))
    return exhibit(
        "unknown",
        ("score", *(text for name in groups for text in (f"{name}, %", "notes, %"))),
        rows,
        best=BEST_SOLVER,
        counts=", ".join(f"{name} {len(tests)}" for name, tests in groups.items()),
    )


def _shipped(tests: Sequence[Rejection]) -> tuple[float, float]:
    """Known rejected and unknown accepted by the limits that ship, in percent."""
    rejected = percent(each.rejected for each in tests)
    accepted = percent(not each.rejected_unknown for each in tests)
    return rejected or 0.0, accepted or 0.0


def _curves(groups: dict[str, list[Rejection]]) -> Exhibit:
    rows: list[Row] = []
    panels = []
    for name, tests in groups.items():
        lines = []
        for score, title in SCORES.items():
            rejected, accepted = rejection_curve([each.pairs[score] for each in tests])
            lines.append(plots.Line(title, rejected, accepted, style="-"))
            points = zip(rejected, accepted, strict=True)
            rows += [(name, score, x, y) for x, y in points if x <= _LISTED_PCT]
        x, y = _shipped(tests)
        rows.append((name, "shipped", x, y))
        lines.append(plots.Line("shipped limits", [x], [y], style="*", colour="#000000"))
        panels.append(plots.Panel(name, tuple(lines)))
    return exhibit(
        "unknown_curves",
        ("tests", "score", "known_rejected_pct", "unknown_accepted_pct"),
        rows,
        draw=partial(
            plots.draw_lines,
            panels=panels,
            x_label="known rejected, %",
            y_label="unknown accepted, %",
            log_x=True,
        ),
        size_in=(13.0, 4.2),
    )
