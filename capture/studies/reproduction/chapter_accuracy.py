"""Exhibits of chapter 9 that count right answers: figures 9.1, 9.11, 9.13 and table 9.1."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial

from . import plots
from .exhibit import Cell, Exhibit, Row, exhibit
from .plan import (
    BEST_SOLVER,
    OF_28_IMAGES,
    OF_SPECTRA,
    ONE_D,
    ONE_SEGMENT,
    OURS,
    SOLVERS,
    TEXTONS,
    THESIS,
)
from .reference import (
    NOT_IN_IT,
    THESIS_PS3_1D,
    THESIS_PS4_1D,
    THESIS_PS4_2D,
    THESIS_SHADOW_WORST,
    THESIS_TEXTONS,
)
from .results import CLASSIFIER_TITLES, SOLVER_TITLES, Results

__all__ = ["accuracy_exhibits"]

_PROTOCOLS = {"turned": "same patch turned", "disjoint": "disjoint patches"}


def accuracy_exhibits(results: Results) -> Iterator[Exhibit]:
    """In the order of the chapter, after a table that sums it up."""
    yield _summary(results)
    yield _by_slant(results)
    yield _by_texture(results)
    yield _one_against_two_dimensions(results)
    yield _against_textons(results)


def _of_chapter(results: Results, solver: str, classifier: str, suffix: str = "") -> list[Cell]:
    """Accuracy on the chapter's textures: by protocol, then by slant."""
    return [
        results.tally.accuracy(
            "thirty", f"slant {slant_deg:g}{suffix}", solver, classifier, protocol
        )
        for protocol in _PROTOCOLS
        for slant_deg in results.plan.chapter_slants_deg
    ]


def _columns_of_chapter(results: Results) -> list[str]:
    return [
        f"{title}, slant {slant_deg:g}, %"
        for title in _PROTOCOLS.values()
        for slant_deg in results.plan.chapter_slants_deg
    ]


def _summary(results: Results) -> Exhibit:
    rows: list[Row] = [
        ("PS3, 1D", *_of_chapter(results, "ps3a", ONE_D, ONE_SEGMENT), THESIS_PS3_1D),
        ("PS4, 1D", *_of_chapter(results, "ps4", ONE_D, ONE_SEGMENT), THESIS_PS4_1D),
        ("PS4, 2D", *_of_chapter(results, "ps4", THESIS, ONE_SEGMENT), THESIS_PS4_2D),
        ("PS4, 2D, averaged over segments", *_of_chapter(results, "ps4", THESIS), NOT_IN_IT),
        (
            "Varma-Zisserman, 28 training images",
            *_of_chapter(results, BEST_SOLVER, TEXTONS, OF_28_IMAGES),
            THESIS_TEXTONS,
        ),
        ("ours: robust PS4, joint", *_of_chapter(results, BEST_SOLVER, OURS), NOT_IN_IT),
    ]
    return exhibit(
        "summary",
        ("system", *_columns_of_chapter(results), "thesis, %"),
        rows,
        digits=2,
        classes=len(results.plan.thirty.textures),
    )


def _by_slant(results: Results) -> Exhibit:
    exams = results.plan.slants.exams
    slants_deg = sorted({exam.conditions.slant_deg for exam in exams})
    systems = (
        *((solver, name, ONE_SEGMENT) for name in (ONE_D, THESIS) for solver in ("ps3a", "ps4")),
        (BEST_SOLVER, OURS, ""),
    )
    rows: list[Row] = []
    panels = []
    worst = {}
    for shadow in ("without", "with"):
        lines = []
        for solver, classifier, suffix in systems:
            values = []
            for slant_deg in slants_deg:
                exam = f"slant {slant_deg:g} {shadow} shadow{suffix}"
                value = results.tally.accuracy("slants", exam, solver, classifier)
                wrong = _wrong(results, [exam], solver, classifier)
                rows.append((shadow, slant_deg, solver, classifier, value, _listed(wrong)))
                values.append(value)
            label = f"{SOLVER_TITLES[solver]}, {CLASSIFIER_TITLES[classifier]}"
            lines.append(plots.Line(label, slants_deg, values))
            if (solver, classifier) == ("ps3a", ONE_D):
                worst[shadow] = min(value for value in values if value is not None)
        panels.append(plots.Panel(f"{shadow} shadow", tuple(lines)))
    wrong = _wrong(results, [exam.name for exam in exams if exam.conditions.shadows], "ps3a", ONE_D)
    return exhibit(
        "figure_9_01",
        ("shadow", "slant_deg", "solver", "classifier", "accuracy_pct", "wrong_by_texture"),
        rows,
        draw=partial(
            plots.draw_lines,
            panels=panels,
            x_label="slant, degrees",
            y_label="accuracy, %",
            levels=((THESIS_SHADOW_WORST, "thesis, lowest with shadow: 95.83"),),
        ),
        size_in=(10.0, 4.2),
        without=f"{worst['without']:.1f}",
        with_=f"{worst['with']:.1f}",
        blamed=f"errors with shadow by texture: {_listed(wrong)}." if wrong else "no errors.",
    )


def _wrong(results: Results, exams: list[str], solver: str, classifier: str) -> Counter[str]:
    """Wrong answers by true texture."""
    return Counter(
        answer.texture
        for exam in exams
        for answer in results.tally.answers("slants", exam, solver, classifier)
        if not answer.right
    )


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{texture} {count}" for texture, count in counts.most_common())


def _by_texture(results: Results) -> Exhibit:
    plan, tally = results.plan, results.tally
    names = [texture.name for texture in plan.thirty.textures]
    systems = (*((solver, ONE_D, ONE_SEGMENT) for solver in SOLVERS), (BEST_SOLVER, OURS, ""))
    panels = []
    columns: dict[str, list[float | None]] = {}
    means = []
    for slant_deg in plan.chapter_slants_deg:
        groups = []
        for solver, classifier, suffix in systems:
            exam = f"slant {slant_deg:g}{suffix}"
            values = [
                tally.accuracy("thirty", exam, solver, classifier, texture=name) for name in names
            ]
            label = f"{SOLVER_TITLES[solver]}, {CLASSIFIER_TITLES[classifier]}"
            colour = plots.OUR_COLOUR if classifier == OURS else plots.COLOURS[solver]
            groups.append((label, colour, values))
            columns[f"slant_{slant_deg:g}_{solver}_{classifier}_pct"] = values
            if classifier == ONE_D:
                mean = tally.accuracy("thirty", exam, solver, classifier)
                means.append(f"{SOLVER_TITLES[solver]} at slant {slant_deg:g} {mean:.1f} %")
        panels.append((f"slant {slant_deg:g}", groups))
    return exhibit(
        "figure_9_11",
        ("texture", *columns),
        [(name, *(values[i] for values in columns.values())) for i, name in enumerate(names)],
        draw=partial(plots.draw_bars, names=names, panels=panels, x_label="accuracy, %"),
        size_in=(10.0, 0.38 * len(names) + 1.0),
        classes=len(names),
        means=", ".join(means),
    )


def _one_against_two_dimensions(results: Results) -> Exhibit:
    plan, tally = results.plan, results.tally
    systems = (
        *((name, ONE_SEGMENT) for name in OF_SPECTRA),
        *((name, "") for name in (*OF_SPECTRA, OURS)),
    )
    rows: list[Row] = []
    panels = []
    order = []
    for protocol, title in _PROTOCOLS.items():
        for slant_deg in plan.chapter_slants_deg:
            groups = []
            for solver in SOLVERS:
                values = [
                    tally.accuracy("thirty", f"slant {slant_deg:g}{suffix}", solver, name, protocol)
                    for name, suffix in systems
                ]
                groups.append((SOLVER_TITLES[solver], plots.COLOURS[solver], values))
                rows += [
                    (protocol, slant_deg, solver, name, _averaging(suffix), value)
                    for (name, suffix), value in zip(systems, values, strict=True)
                ]
                if solver == "ps4":
                    one, two = (values[systems.index((n, ONE_SEGMENT))] for n in (ONE_D, THESIS))
                    order.append(
                        f"{title} at slant {slant_deg:g}, 1D {one:.1f} % and 2D {two:.1f} %"
                    )
            panels.append((f"{title}, slant {slant_deg:g}", groups))
    return exhibit(
        "figure_9_13",
        ("protocol", "slant_deg", "solver", "classifier", "segments", "accuracy_pct"),
        rows,
        draw=partial(
            plots.draw_bars,
            names=[f"{CLASSIFIER_TITLES[name]}{suffix}" for name, suffix in systems],
            panels=panels,
            x_label="accuracy, %",
        ),
        size_in=(12.0, 5.6),
        order="; ".join(order),
    )


def _averaging(suffix: str) -> str:
    return "one" if suffix == ONE_SEGMENT else "averaged"


def _against_textons(results: Results) -> Exhibit:
    plan = results.plan
    thesis = {(THESIS, 4): THESIS_PS4_2D, (TEXTONS, 28): THESIS_TEXTONS}
    rows: list[Row] = []
    for cost in results.costs:
        suffix = OF_28_IMAGES if cost.training_images == 28 else ""
        rows.append(
            (
                CLASSIFIER_TITLES[cost.classifier],
                cost.training_images,
                cost.images,
                *_of_chapter(results, BEST_SOLVER, cost.classifier, suffix),
                thesis.get((cost.classifier, cost.training_images), NOT_IN_IT),
                cost.solve_ms,
                cost.match_ms,
                cost.solve_ms + cost.match_ms,
            )
        )
    return exhibit(
        "table_9_01",
        (
            "classifier",
            "training images a class",
            "images of a test",
            *_columns_of_chapter(results),
            "thesis, %",
            "solve, ms",
            "match, ms",
            "together, ms",
        ),
        rows,
        digits=2,
        size=plan.thirty.frame_px,
        classes=len(plan.thirty.textures),
        best=BEST_SOLVER,
    )
