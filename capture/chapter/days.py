"""Exhibits of tests on another day than training: faults of the rig, and unknown textures."""

from collections.abc import Iterator

from classify.library.evaluation import nearest_accuracy

from .exhibit import Exhibit, Row
from .plan import BEST_SOLVER, OURS, Experiment, TestRun
from .results import Results, answers_pct, percent
from .runs import Outcome, System

_SHARES = ("nearest right, %", "right, %", "refused, %", "wrong, %", "unknown accepted, %")


def days_exhibits(results: Results) -> Iterator[Exhibit]:
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


def _outcomes(results: Results, experiment: Experiment, test: TestRun) -> list[Outcome]:
    return results.outcomes[System(experiment.name, test.name, BEST_SOLVER, OURS)]


def _shares_pct(outcomes: list[Outcome]) -> Row:
    nearest = percent(nearest_accuracy([each.trial for each in outcomes]))
    return (nearest, *answers_pct(outcomes))
