"""Exhibits of chapter 9 that show accuracy: figures 9.1, 9.11 and 9.13, table 9.1."""

from collections import Counter
from collections.abc import Iterator
from functools import partial

from . import plan, plots
from .output import Cell, Exhibit, Row
from .results import CLASSIFIER_TITLES, SOLVER_TITLES, Results
from .runs import System

# Accuracies of the thesis (see page.html), in percent.
_THESIS_PS3_1D, _THESIS_PS4_1D, _THESIS_PS4_2D = 90.56, 95.93, 99.07
_THESIS_TEXTONS, _THESIS_WORST_WITH_SHADOW = 100.0, 95.83
_NOT_IN_THESIS = "not in it"

_PROTOCOLS: dict[plan.Protocol, str] = {
    "rotated": "same patch rotated", "disjoint": "disjoint patches",
}  # fmt: skip


def accuracy_exhibits(results: Results) -> Iterator[Exhibit]:
    """Make a summary and the exhibits in the order of the chapter."""
    yield _summary(results)
    yield _by_slant(results)
    yield _by_texture(results)
    yield _one_against_two_dimensions(results)
    yield _against_textons(results)


def _title(solver: str, classifier: str) -> str:
    return f"{SOLVER_TITLES[solver]}, {CLASSIFIER_TITLES[classifier]}"


def _of_chapter(results: Results, solver: str, classifier: str, suffix: str = "") -> list[Cell]:
    """Accuracy on the textures of the chapter: by protocol, then by slant."""
    return [
        results.trials.accuracy_pct(
            "thirty", f"slant {slant:g}{suffix}", solver, classifier, protocol
        )
        for protocol in _PROTOCOLS
        for slant in results.plan.chapter_slants_deg
    ]


def _columns_of_chapter(results: Results) -> list[str]:
    return [
        f"{title}, slant {slant_deg:g}, %"
        for title in _PROTOCOLS.values()
        for slant_deg in results.plan.chapter_slants_deg
    ]


def _summary(results: Results) -> Exhibit:
    systems: tuple[tuple[str, str, str, str, Cell], ...] = (
        ("PS3, 1D", "ps3a", plan.ONE_D, plan.ONE_SEGMENT, _THESIS_PS3_1D),
        ("PS4, 1D", "ps4", plan.ONE_D, plan.ONE_SEGMENT, _THESIS_PS4_1D),
        ("PS4, 2D", "ps4", plan.THESIS, plan.ONE_SEGMENT, _THESIS_PS4_2D),
        ("PS4, 2D, averaged over segments", "ps4", plan.THESIS, "", _NOT_IN_THESIS),
        ("Varma-Zisserman, 28 training images",
         plan.BEST_SOLVER, plan.TEXTONS, plan.OF_28_IMAGES, _THESIS_TEXTONS),
        ("ours: robust PS4, joint", plan.BEST_SOLVER, plan.OURS, "", _NOT_IN_THESIS),
    )  # fmt: skip
    return Exhibit(
        "summary",
        ("system", *_columns_of_chapter(results), "thesis, %"),
        [(name, *_of_chapter(results, *system), thesis) for name, *system, thesis in systems],
        digits=2,
        values=results.plan.thirty.facts,
    )


def _by_slant(results: Results) -> Exhibit:
    tests = results.plan.slants.tests
    slants_deg = sorted({test.conditions.slant_deg for test in tests})
    systems = (
        *(
            (solver, name, plan.ONE_SEGMENT)
            for name in (plan.ONE_D, plan.THESIS)
            for solver in ("ps3a", "ps4")
        ),
        (plan.BEST_SOLVER, plan.OURS, ""),
    )
    rows: list[Row] = []
    panels = []
    for shadow in ("without", "with"):
        lines = []
        for solver, classifier, suffix in systems:
            values = []
            for slant_deg in slants_deg:
                test = f"slant {slant_deg:g} {shadow} shadow{suffix}"
                value = results.trials.accuracy_pct("slants", test, solver, classifier)
                wrong = _wrong_by_texture(results, System("slants", test, solver, classifier))
                rows.append((shadow, slant_deg, solver, classifier, value, wrong))
                values.append(value)
            lines.append(plots.Line(_title(solver, classifier), slants_deg, values))
        panels.append((f"{shadow} shadow", lines))
    return Exhibit(
        "figure_9_01",
        ("shadow", "slant_deg", "solver", "classifier", "accuracy_pct", "wrong_by_texture"),
        rows,
        draw=partial(
            plots.draw_lines,
            panels=panels,
            x_label="slant, degrees",
            y_label="accuracy, %",
            levels=((_THESIS_WORST_WITH_SHADOW, "thesis, lowest with shadow: 95.83"),),
        ),
        size_in=(10.0, 4.2),
    )


def _wrong_by_texture(results: Results, system: System) -> str:
    """Numbers of wrong answers by true texture, as text."""
    counts = Counter(t.label for t in results.trials[system] if not t.nearest_is_correct)
    return ", ".join(f"{texture} {count}" for texture, count in counts.most_common())


def _by_texture(results: Results) -> Exhibit:
    names = [texture.name for texture in results.plan.thirty.textures]
    systems = (
        *((solver, plan.ONE_D, plan.ONE_SEGMENT) for solver in plan.SOLVERS),
        (plan.BEST_SOLVER, plan.OURS, ""),
    )
    panels = []
    columns: dict[str, list[float | None]] = {}
    for slant_deg in results.plan.chapter_slants_deg:
        groups = []
        for solver, classifier, suffix in systems:
            system = ("thirty", f"slant {slant_deg:g}{suffix}", solver, classifier)
            values = [results.trials.accuracy_pct(*system, texture=name) for name in names]
            colour = plots.OUR_COLOUR if classifier == plan.OURS else plots.COLOURS[solver]
            groups.append((_title(solver, classifier), colour, values))
            columns[f"slant_{slant_deg:g}_{solver}_{classifier}_pct"] = values
        panels.append((f"slant {slant_deg:g}", groups))
    return Exhibit(
        "figure_9_11",
        ("texture", *columns),
        list(zip(names, *columns.values(), strict=True)),
        draw=partial(plots.draw_bars, names=names, panels=panels),
        size_in=(10.0, 0.38 * len(names) + 1.0),
        values=results.plan.thirty.facts,
    )


def _one_against_two_dimensions(results: Results) -> Exhibit:
    systems = (
        *((name, plan.ONE_SEGMENT) for name in plan.OF_SPECTRA),
        *((name, "") for name in (*plan.OF_SPECTRA, plan.OURS)),
    )
    names = [f"{CLASSIFIER_TITLES[name]}{suffix}" for name, suffix in systems]
    rows: list[Row] = []
    panels = []
    for protocol, title in _PROTOCOLS.items():
        for slant_deg in results.plan.chapter_slants_deg:
            groups = []
            for solver in plan.SOLVERS:
                values = []
                for name, suffix in systems:
                    test = f"slant {slant_deg:g}{suffix}"
                    value = results.trials.accuracy_pct("thirty", test, solver, name, protocol)
                    segments = "one" if suffix else "averaged"
                    rows.append((protocol, slant_deg, solver, name, segments, value))
                    values.append(value)
                groups.append((SOLVER_TITLES[solver], plots.COLOURS[solver], values))
            panels.append((f"{title}, slant {slant_deg:g}", groups))
    return Exhibit(
        "figure_9_13",
        ("protocol", "slant_deg", "solver", "classifier", "segments", "accuracy_pct"),
        rows,
        draw=partial(plots.draw_bars, names=names, panels=panels),
        size_in=(12.0, 5.6),
    )


def _against_textons(results: Results) -> Exhibit:
    thesis = {(plan.THESIS, 4): _THESIS_PS4_2D, (plan.TEXTONS, 28): _THESIS_TEXTONS}
    rows: list[Row] = [
        (
            CLASSIFIER_TITLES[cost.classifier],
            cost.training_images,
            cost.images,
            *_of_chapter(
                results, plan.BEST_SOLVER, cost.classifier,
                plan.OF_28_IMAGES if cost.training_images == 28 else "",
            ),
            thesis.get((cost.classifier, cost.training_images), _NOT_IN_THESIS),
            cost.solve_ms,
            cost.match_ms,
            cost.solve_ms + cost.match_ms,
        )
        for cost in results.costs
    ]  # fmt: skip
    columns = ("classifier", "training images a class", "images of a test")
    return Exhibit(
        "table_9_01",
        (
            *columns, *_columns_of_chapter(results), "thesis, %",
            "solve, ms", "match, ms", "together, ms",
        ),
        rows,
        digits=2,
        values=results.plan.thirty.facts,
    )  # fmt: skip
