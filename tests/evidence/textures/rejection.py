"""Exhibits of unknown textures: share of them that is accepted as a known class."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from capture.chapter import plots
from capture.chapter.output import Exhibit, Row
from capture.chapter.plan import OURS, THESIS

from .open_set import Outcome, answers_pct
from .results import TextureResults

_TITLES = {OURS: "joint distance over the limit of the class", THESIS: "2D spectra of the thesis"}
# Share of known tests that the limit of the table rejects.
_REJECTED = 0.01
# The CSV of the curves ends here: a rig that rejects more of its own classes is of no use.
_LISTED_PCT = 20.0

Groups = Mapping[str, Mapping[str, Sequence[Outcome]]]
Scores = npt.NDArray[np.float64]
"""Distances to the nearest class over the limit of that class, if the classifier has limits."""


def rejection_exhibits(results: TextureResults) -> Iterator[Exhibit]:
    """The table at 1 % false rejection, and the curves of both scores."""
    groups = _groups(results)
    if groups:
        yield _table(groups)
        yield _curves(groups)


def accepted_pct(known: Scores, unknown: Scores, rejected: float) -> float:
    """Percent of unknown accepted if a limit rejects at most `rejected` of the known."""
    kept = math.ceil((1.0 - rejected) * len(known) - 1e-9)
    return 100.0 * float(np.mean(unknown <= np.sort(known)[max(kept, 1) - 1]))


def rejection_curve(known: Scores, unknown: Scores) -> tuple[list[float], list[float]]:
    """Known rejected and unknown accepted, in percent, for every limit."""
    limits = np.sort(known)[::-1]
    accepted = np.searchsorted(np.sort(unknown), limits, side="right") / len(unknown)
    rejected = np.arange(len(limits)) / len(limits)
    return (100.0 * rejected).tolist(), (100.0 * accepted).tolist()


def _groups(results: TextureResults) -> Groups:
    """Outcomes on disjoint patches by test run and classifier."""
    groups: dict[str, dict[str, list[Outcome]]] = {}
    for system, outcomes in results.outcomes.items():
        asked = [each for each in outcomes if each.match_without_class is not None]
        if (
            asked
            and system.protocol == "disjoint"
            and system.experiment in ("synthetic", "materials")
        ):
            name = "materials" if system.experiment == "materials" else system.test
            groups.setdefault(name, {})[system.classifier] = asked
    return groups


def _scores(outcomes: Sequence[Outcome]) -> tuple[Scores, Scores]:
    """Scores of all tests with and without their class in the library."""
    known = [each.trial.match for each in outcomes]
    unknown = [match for each in outcomes if (match := each.match_without_class)]
    known_scores, unknown_scores = (
        np.array([match.distance / (match.limit or 1.0) for match in matches])
        for matches in (known, unknown)
    )
    return known_scores, unknown_scores


def _table(groups: Groups) -> Exhibit:
    rows: list[Row] = [
        (title, *(accepted_pct(*_scores(tests[name]), _REJECTED) for tests in groups.values()))
        for name, title in _TITLES.items()
    ]
    trained = [answers_pct(tests[OURS]) for tests in groups.values()]
    rows.append(("limits from training: known rejected", *(each.refused for each in trained)))
    rows.append(("limits from training: unknown accepted", *(each.accepted for each in trained)))
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
            rejected, accepted = rejection_curve(*_scores(tests[classifier]))
            lines.append(plots.Line(title, rejected, accepted, style="-"))
            points = zip(rejected, accepted, strict=True)
            rows += [(name, classifier, x, y) for x, y in points if x <= _LISTED_PCT]
        trained = answers_pct(tests[OURS])
        x, y = trained.refused, trained.accepted
        rows.append((name, "limits from training", x, y))
        lines.append(plots.Line("limits from training", [x], [y], style="*", colour="#000000"))
        panels.append((name, lines))
    return Exhibit(
        "unknown_curves",
        ("tests", "score", "known_rejected_pct", "unknown_accepted_pct"),
        rows,
        draw=partial(_draw, panels=panels),
        size_in=(13.0, 4.2),
    )


def _draw(figure: Figure, panels: Sequence[tuple[str, Sequence[plots.Line]]]) -> None:
    plots.draw_lines(figure, panels, "known rejected, %", "unknown accepted, %")
    for ax in figure.axes:
        ax.set_xscale("symlog", linthresh=1.0)
