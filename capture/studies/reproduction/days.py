"""Exhibits of tests on another day than training: faults of the rig, and unknown textures."""

from collections.abc import Iterator, Sequence

from .exhibit import Exhibit, Row
from .plan import BEST_SOLVER, OURS, TestRun
from .results import Results, answers_pct
from .runs import Outcome, System


def days_exhibits(results: Results) -> Iterator[Exhibit]:
    """The table of faults, and the table of unknown textures by size and number of sets."""
    experiment = results.plan.days
    first = experiment.training[0]
    values = {"materials": len(first.textures), "size": first.conditions.size_px}
    rows: list[Row] = [
        (test.name, *answers_pct(_outcomes(results, test)))
        for test in experiment.tests
        if test.training == first
    ]
    columns = ("right, %", "refused, %", "wrong, %", "unknown accepted, %")
    yield Exhibit("days", ("fault in the test only", *columns), rows, values=values)
    rows = []
    for test in experiment.tests:
        if test.conditions == test.training.conditions:
            outcomes = _outcomes(results, test)
            sets = len(test.training.orientations_deg)
            rows.append((test.conditions.size_px, sets, *answers_pct(outcomes)))
    yield Exhibit("open_set", ("frame, px", "training sets a class", *columns), rows, values=values)


def _outcomes(results: Results, test: TestRun) -> Sequence[Outcome]:
    return results.outcomes[System("days", test.name, BEST_SOLVER, OURS)]
