"""Exhibits beyond the chapter: classifiers, materials, orientation, robustness."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial

from . import plots
from .exhibit import Cell, Exhibit, Row, exhibit
from .plan import BEST_SOLVER, OURS, SOLVERS, THESIS, Exam
from .reference import NOTES_MATERIALS, NOTES_SYNTHETIC, NOTES_TWINS
from .results import CLASSIFIER_TITLES, SOLVER_TITLES, Results
from .tally import DIRECTIONAL_SHARPNESS, percent, quantile

__all__ = ["comparison_exhibits"]

_ORDER = {title: place for place, title in enumerate(CLASSIFIER_TITLES.values())}


def comparison_exhibits(results: Results) -> Iterator[Exhibit]:
    """In the order of the page."""
    yield _synthetic(results)
    yield _twins_and_small(results)
    yield _materials(results)
    yield _orientation(results)
    yield _robustness(results)


def _synthetic(results: Results) -> Exhibit:
    experiment = results.plan.synthetic
    whole = [exam for exam in experiment.exams if exam.lesson.rejecting]
    classifiers = whole[0].lesson.classifiers
    rows: list[Row] = []
    panels = []
    for exam in whole:
        slant_deg = round(exam.conditions.slant_deg)
        by_solver = {
            solver: [
                results.tally.accuracy("synthetic", exam.name, solver, name) for name in classifiers
            ]
            for solver in SOLVERS
        }
        for index, name in enumerate(classifiers):
            noted = NOTES_SYNTHETIC.get(name)
            cells: list[Cell] = []
            for place, values in enumerate(by_solver.values()):
                cells += [values[index], None if noted is None else noted[1][slant_deg][place]]
            rows.append((CLASSIFIER_TITLES[name], slant_deg, *cells))
        groups = [
            (SOLVER_TITLES[solver], plots.COLOURS[solver], values)
            for solver, values in by_solver.items()
        ]
        panels.append((f"slant {slant_deg}", groups))
    rows.sort(key=lambda row: _ORDER[str(row[0])])
    names = [CLASSIFIER_TITLES[name] for name in classifiers]
    return exhibit(
        "classifiers_synthetic",
        ("classifier", "slant, degrees", *_with_notes(f"{SOLVER_TITLES[s]}, %" for s in SOLVERS)),
        rows,
        draw=partial(plots.draw_bars, names=names, panels=panels, x_label="accuracy, %"),
        size_in=(11.0, 4.6),
        classes=len(whole[0].lesson.textures),
        size=whole[0].conditions.size_px,
        tests=len(experiment.turns_deg),
        notes="; ".join(
            f"{CLASSIFIER_TITLES[name]}: {noted[0]}"
            for name, noted in NOTES_SYNTHETIC.items()
            if name in classifiers
        ),
    )


def _with_notes(columns: Iterable[str]) -> list[str]:
    return [text for column in columns for text in (column, "notes, %")]


def _twins_and_small(results: Results) -> Exhibit:
    rows: list[Row] = []
    for exam in results.plan.synthetic.exams:
        if exam.lesson.rejecting:
            continue
        side, slant_deg = exam.conditions.size_px, round(exam.conditions.slant_deg)
        twins = exam.name.endswith("twins")
        for name in exam.lesson.classifiers:
            numbers = [results.tally.accuracy("synthetic", exam.name, s, name) for s in SOLVERS]
            small = NOTES_SYNTHETIC[f"{OURS}, small"][1][slant_deg][-1]
            noted = (NOTES_TWINS if twins else small) if name == OURS else None
            rows.append(
                (
                    f"{side} px, with twins" if twins else f"{side} px",
                    len(exam.lesson.textures),
                    CLASSIFIER_TITLES[name],
                    slant_deg,
                    *numbers,
                    noted,
                )
            )
    rows.sort(key=lambda row: (-len(str(row[0])), _ORDER[str(row[2])]))
    solvers = [f"{SOLVER_TITLES[solver]}, %" for solver in SOLVERS]
    return exhibit(
        "classifiers_twins_and_small",
        ("patches", "classes", "classifier", "slant, degrees", *solvers, "notes, %"),
        rows,
    )


def _materials(results: Results) -> Exhibit:
    experiment = results.plan.materials
    rows: list[Row] = []
    for protocol in ("disjoint", "turned"):
        for name in experiment.exams[0].lesson.classifiers:
            noted = NOTES_MATERIALS.get((name, protocol), {})
            for solver in experiment.exams[0].lesson.solvers:
                cells: list[Cell] = []
                for exam in experiment.exams:
                    value = results.tally.accuracy("materials", exam.name, solver, name, protocol)
                    cells += [value, noted.get(exam.conditions.size_px)]
                rows.append((protocol, CLASSIFIER_TITLES[name], SOLVER_TITLES[solver], *cells))
    sizes = [f"{exam.conditions.size_px} px, %" for exam in experiment.exams]
    return exhibit(
        "materials",
        ("patches", "classifier", "solver", *_with_notes(sizes)),
        rows,
        classes=len(experiment.textures),
        tests=len(experiment.turns_deg),
        materials=", ".join(texture.name for texture in experiment.textures),
    )


def _orientation(results: Results) -> Exhibit:
    plan = results.plan
    asked: list[tuple[str, str, Exam, str]] = [
        (f"synthetic, {exam.name}", "synthetic", exam, "disjoint")
        for exam in plan.synthetic.exams
        if exam.lesson.rejecting
    ]
    asked += [
        (f"chapter's textures, {exam.name}", "thirty", exam, "disjoint")
        for exam in plan.thirty.exams
        if OURS in exam.lesson.classifiers
    ]
    asked += [
        (f"materials, {exam.name}, {protocol}", "materials", exam, protocol)
        for protocol in ("disjoint", "turned")
        for exam in plan.materials.exams
    ]
    rows: list[Row] = []
    for title, experiment, exam, protocol in asked:
        for name in (OURS, THESIS):
            errors = results.tally.orientation_errors_deg(
                experiment, exam.name, BEST_SOLVER, name, protocol
            )
            rows.append(
                (
                    title,
                    CLASSIFIER_TITLES[name],
                    len(errors),
                    quantile(errors, 0.5),
                    quantile(errors, 0.95),
                    percent(error > 10.0 for error in errors),
                    percent(error > 80.0 for error in errors),
                )
            )
    return exhibit(
        "orientation",
        (
            "textures",
            "classifier",
            "tests",
            "median, °",
            "95 %, °",
            "beyond 10°, %",
            "beyond 80°, %",
        ),
        rows,
        digits=2,
        sharpness=f"{DIRECTIONAL_SHARPNESS:g}",
        best=BEST_SOLVER,
    )


def _robustness(results: Results) -> Exhibit:
    experiment, tally = results.plan.robustness, results.tally
    rows: list[Row] = []
    for exam in experiment.exams:
        errors = tally.orientation_errors_deg("robustness", exam.name, BEST_SOLVER, OURS)
        rows.append(
            (
                exam.name,
                tally.accuracy("robustness", exam.name, BEST_SOLVER, OURS),
                tally.rejected("robustness", exam.name, BEST_SOLVER, "disjoint"),
                quantile(errors, 0.5),
                quantile(errors, 0.95),
                tally.accuracy("robustness", exam.name, BEST_SOLVER, THESIS),
            )
        )
    learned = experiment.exams[0].lesson
    return exhibit(
        "robustness",
        (
            "test",
            "joint (ours), %",
            "called unknown, %",
            "orientation: median, °",
            "95 %, °",
            "2D spectra, magnitude, %",
        ),
        rows,
        digits=2,
        classes=len(learned.textures),
        size=learned.conditions.size_px,
        tests=len(experiment.turns_deg),
        best=BEST_SOLVER,
    )
