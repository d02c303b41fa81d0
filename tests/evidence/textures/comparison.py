"""Exhibits beyond the chapter: classifiers, materials, orientation, robustness."""

from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt

from capture.chapter import plots
from capture.chapter.output import Cell, Exhibit, Row
from capture.chapter.plan import BEST_SOLVER, OURS, SOLVERS, THESIS, TestRun
from capture.chapter.results import CLASSIFIER_TITLES, SOLVER_TITLES
from capture.chapter.runs import System

from .plan import OpenSetRun
from .results import DIRECTIONAL_SHARPNESS, TextureResults

_ORDER = {title: place for place, title in enumerate(CLASSIFIER_TITLES.values())}
_SOLVER_COLUMNS = tuple(f"{SOLVER_TITLES[solver]}, %" for solver in SOLVERS)


def comparison_exhibits(results: TextureResults) -> Iterator[Exhibit]:
    """Make the exhibits in the order of the page."""
    yield _synthetic(results)
    yield _twins_and_small(results)
    yield _materials(results)
    yield _orientation(results)
    yield _robustness(results)


def _synthetic(results: TextureResults) -> Exhibit:
    experiment = results.plan.synthetic
    tests = [test for test in experiment.tests if isinstance(test.training, OpenSetRun)]
    classifiers = tests[0].training.classifiers
    names = [CLASSIFIER_TITLES[name] for name in classifiers]
    rows: list[Row] = []
    panels = []
    for test in tests:
        slant_deg = round(test.conditions.slant_deg)
        cells = [_of_solvers(results, test, name) for name in classifiers]
        rows += [(title, slant_deg, *each) for title, each in zip(names, cells, strict=True)]
        groups = [
            (SOLVER_TITLES[solver], plots.COLOURS[solver], values)
            for solver, values in zip(SOLVERS, zip(*cells, strict=True), strict=True)
        ]
        panels.append((f"slant {slant_deg}", groups))
    rows.sort(key=lambda row: _ORDER[str(row[0])])
    return Exhibit(
        "classifiers_synthetic",
        ("classifier", "slant, degrees", *_SOLVER_COLUMNS),
        rows,
        draw=partial(plots.draw_bars, names=names, panels=panels),
        size_in=(11.0, 4.6),
        values=experiment.facts,
    )


def _twins_and_small(results: TextureResults) -> Exhibit:
    rows: list[Row] = []
    for test in results.plan.synthetic.tests:
        if isinstance(test.training, OpenSetRun):
            continue
        patches = f"{test.conditions.size_px} px"
        if test.name.endswith("twins"):
            patches += ", with twins"
        classes, slant_deg = len(test.training.textures), round(test.conditions.slant_deg)
        for name in test.training.classifiers:
            cells = _of_solvers(results, test, name)
            rows.append((patches, classes, CLASSIFIER_TITLES[name], slant_deg, *cells))
    rows.sort(key=lambda row: (-len(str(row[0])), _ORDER[str(row[2])]))
    return Exhibit(
        "classifiers_twins_and_small",
        ("patches", "classes", "classifier", "slant, degrees", *_SOLVER_COLUMNS),
        rows,
    )


def _of_solvers(results: TextureResults, test: TestRun, classifier: str) -> list[float | None]:
    return [results.trials.accuracy_pct("synthetic", test.name, s, classifier) for s in SOLVERS]


def _materials(results: TextureResults) -> Exhibit:
    experiment = results.plan.materials
    training = experiment.training[0]
    rows: list[Row] = []
    for protocol in reversed(experiment.protocols):
        for name in training.classifiers:
            for solver in training.solvers:
                accuracies = (
                    results.trials.accuracy_pct("materials", test.name, solver, name, protocol)
                    for test in experiment.tests
                )
                rows.append((protocol, CLASSIFIER_TITLES[name], SOLVER_TITLES[solver], *accuracies))
    sizes = [f"{test.conditions.size_px} px, %" for test in experiment.tests]
    return Exhibit(
        "materials",
        ("patches", "classifier", "solver", *sizes),
        rows,
        values={"materials": ", ".join(t.name for t in experiment.textures), **experiment.facts},
    )


def _orientation(results: TextureResults) -> Exhibit:
    plan = results.plan
    systems = {
        f"synthetic, {test.name}": System("synthetic", test.name, BEST_SOLVER, OURS)
        for test in plan.synthetic.tests
        if isinstance(test.training, OpenSetRun)
    }
    systems |= {
        f"chapter's textures, {test.name}": System("thirty", test.name, BEST_SOLVER, OURS)
        for test in plan.thirty.tests
        if OURS in test.training.classifiers
    }
    systems |= {
        f"materials, {test.name}, {p}": System("materials", test.name, BEST_SOLVER, OURS, p)
        for p in reversed(plan.materials.protocols)
        for test in plan.materials.tests
    }
    rows: list[Row] = []
    for title, ours in systems.items():
        for name in (OURS, THESIS):
            errors = results.orientation_errors_deg(ours._replace(classifier=name))
            beyond = [100.0 * float(np.mean(errors > deg)) for deg in (10.0, 80.0) if errors.size]
            cells = (*_median_and_p95(errors), *(beyond or (None, None)))
            rows.append((title, CLASSIFIER_TITLES[name], len(errors), *cells))
    columns = ("textures", "classifier", "tests")
    return Exhibit(
        "orientation",
        (*columns, "median, °", "95 %, °", "beyond 10°, %", "beyond 80°, %"),
        rows,
        digits=2,
        values={"sharpness": f"{DIRECTIONAL_SHARPNESS:g}"},
    )


def _robustness(results: TextureResults) -> Exhibit:
    experiment = results.plan.robustness
    rows: list[Row] = []
    for test in experiment.tests:
        ours = System("robustness", test.name, BEST_SOLVER, OURS)
        unknown = [trial.match.label is None for trial in results.trials[ours]]
        unknown_pct = 100.0 * sum(unknown) / max(len(unknown), 1)
        errors = _median_and_p95(results.orientation_errors_deg(ours))
        ours_pct, thesis_pct = (
            results.trials.accuracy_pct(*ours._replace(classifier=name)) for name in (OURS, THESIS)
        )
        rows.append((test.name, ours_pct, unknown_pct, *errors, thesis_pct))
    columns = ("joint (ours), %", "called unknown, %", "orientation: median, °", "95 %, °")
    return Exhibit(
        "robustness",
        ("test", *columns, "2D spectra, magnitude, %"),
        rows,
        digits=2,
        values=experiment.facts,
    )


def _median_and_p95(errors: npt.NDArray[np.float64]) -> list[Cell]:
    return np.percentile(errors, (50, 95)).tolist() if errors.size else [None, None]
