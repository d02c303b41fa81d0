"""Exhibits of tests on another day than training: faults of the rig, and unknown textures."""

from collections.abc import Iterator

from capture.chapter.output import Exhibit, Row
from capture.chapter.plan import BEST_SOLVER, OURS, Experiment, TestRun
from capture.chapter.runs import System
from classify.library.evaluation import nearest_accuracy

from .open_set import Outcome, answers_pct
from .results import TextureResults

_SHARES = ("nearest right, %", "right, %", "refused, %", "wrong, %", "unknown accepted, %")


def days_exhibits(results: TextureResults) -> Iterator[Exhibit]:
    """The table of faults, and the table of unknown textures by size and number of sets."""
    days, small = results.plan.days, results.plan.small_frames
    first = days.training[0]
    values = {"materials": len(first.textures), "size": first.conditions.size_px}
    rows: list[Row] = [
        (test.name, *_shares_pct(_outcomes(results, days, test)))
        for test in days.tests
        if test.training == first
    ]
    yield Exhibit("days", ("fault in the test only", *_SHARES), rows, values=values)
    outcomes: dict[tuple[int, int], list[Outcome]] = {}
    for experiment in (days, small):
        for test in experiment.tests:
            if test.conditions == test.training.conditions:
                key = (test.conditions.size_px, len(test.training.places))
                outcomes.setdefault(key, []).extend(_outcomes(results, experiment, test))
    rows = [(*key, len(each), *_shares_pct(each)) for key, each in outcomes.items()]
    columns = ("frame, px", "training sets a class", "tests", *_SHARES)
    yield Exhibit("open_set", columns, rows, values=values)


def _outcomes(results: TextureResults, experiment: Experiment, test: TestRun) -> list[Outcome]:
    return results.outcomes[System(experiment.name, test.name, BEST_SOLVER, OURS)]


def _shares_pct(outcomes: list[Outcome]) -> Row:
    nearest = nearest_accuracy([outcome.trial for outcome in outcomes])
    return (None if nearest is None else 100.0 * nearest, *answers_pct(outcomes))
