"""The figures and tables of chapter 9: accuracy, shadow, relief, albedo, polar spectra."""

import os
import platform
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from classify.base.durable_file import make_folder

from . import plan, plots
from .output import Cell, Exhibit, PageInfo, Row, write_page
from .results import (
    CLASSIFIER_TITLES,
    SAND_SLANT_DEG,
    SHADOW_TILTS_DEG,
    SOLVER_TITLES,
    TRUTH,
    Results,
    measure,
)
from .runs import System, patch_tasks

# Accuracies of the thesis (cited in chapter.html), in percent.
_THESIS_PS3_1D, _THESIS_PS4_1D, _THESIS_PS4_2D = 90.56, 95.93, 99.07
_THESIS_TEXTONS, _THESIS_WORST_WITH_SHADOW = 100.0, 95.83
_NOT_IN_THESIS = "not in it"

_OUR_COLOUR = "#f4c542"  # of our classifier, where others have the colours of their solvers
_PROTOCOLS: dict[plan.Protocol, str] = {
    "rotated": "same patch rotated", "disjoint": "disjoint patches",
}  # fmt: skip


def reproduce(
    planned: plan.Plan, output: Path, workers: int | None = None, scheduler: str | None = None
) -> Path:
    """Measure a plan and write all files into a folder; returns the page."""
    make_folder(output)
    started_s = time.monotonic()
    results = measure(planned, output, workers, scheduler)
    exhibits = list(_exhibits(results))
    facts = {
        "textures": f"{len(planned.thirty.textures)}",
        "frames": f"{planned.frame_px} px",
        "test patches": f"{sum(len(list(patch_tasks(e, output))) for e in planned.experiments)}",
        "answers": f"{sum(map(len, results.trials.values()))}",
        "duration": f"{(time.monotonic() - started_s) / 60.0:.1f} min on {os.cpu_count()} cores, "
        f"{platform.machine()}",
    }
    introduction = Path(__file__).with_name("chapter.html")
    info = PageInfo("reproduction", introduction, simulated=True, quick=planned.quick)
    return write_page(exhibits, facts, info, output)


def _exhibits(results: Results) -> Iterator[Exhibit]:
    """Make all figures and tables in the order of the page."""
    yield _summary(results)
    exhibits = [
        _by_slant(results),
        _by_texture(results),
        _one_against_two_dimensions(results),
        _against_textons(results),
        *_surface_exhibits(results),
    ]
    yield from sorted(exhibits, key=lambda exhibit: exhibit.key)


def _title(solver: str, classifier: str) -> str:
    return f"{SOLVER_TITLES[solver]}, {CLASSIFIER_TITLES[classifier]}"


def _chapter_accuracies(
    results: Results, solver: str, classifier: str, suffix: str = ""
) -> list[Cell]:
    """Accuracy on the textures of the chapter: by protocol, then by slant."""
    return [
        results.trials.accuracy_pct(
            "thirty", f"slant {slant:g}{suffix}", solver, classifier, protocol
        )
        for protocol in _PROTOCOLS
        for slant in results.plan.chapter_slants_deg
    ]


def _chapter_columns(results: Results) -> list[str]:
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
         plan.BEST_SOLVER, plan.TEXTONS, plan.WITH_28_IMAGES, _THESIS_TEXTONS),
        ("ours: robust PS4, joint", plan.BEST_SOLVER, plan.OURS, "", _NOT_IN_THESIS),
    )  # fmt: skip
    return Exhibit(
        "summary",
        ("system", *_chapter_columns(results), "thesis, %"),
        [
            (name, *_chapter_accuracies(results, *system), thesis)
            for name, *system, thesis in systems
        ],
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
                wrong_answers = _wrong_by_texture(
                    results, System("slants", test, solver, classifier)
                )
                rows.append((shadow, slant_deg, solver, classifier, value, wrong_answers))
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
    trials = results.trials[system]
    counts = Counter(trial.label for trial in trials if not trial.nearest_is_correct)
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
            colour = _OUR_COLOUR if classifier == plan.OURS else plots.COLOURS[solver]
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
        *((name, plan.ONE_SEGMENT) for name in plan.SPECTRA_CLASSIFIERS),
        *((name, "") for name in (*plan.SPECTRA_CLASSIFIERS, plan.OURS)),
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
            *_chapter_accuracies(
                results, plan.BEST_SOLVER, cost.classifier,
                plan.WITH_28_IMAGES if cost.training_images == 28 else "",
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
            *columns, *_chapter_columns(results), "thesis, %",
            "solve, ms", "match, ms", "together, ms",
        ),
        rows,
        digits=2,
        values=results.plan.thirty.facts,
    )  # fmt: skip


# Figure 9.3: percent of the pixels of sand in shadow of a light at tilt 0, by slant in degrees.
_THESIS_SAND_SHADOW_PCT = {40: 1.0, 50: 7.0, 60: 19.0, 70: 37.0, 80: 61.0}

_SHOWN_SOLVERS = (TRUTH, *plan.SOLVERS)
_SLANT = f"{SAND_SLANT_DEG:g}"


def _surface_exhibits(results: Results) -> Iterator[Exhibit]:
    """Make figures 9.2, 9.3, 9.5 and 9.7 to 9.10."""
    maps = results.maps
    yield _shadow_by_texture(results)
    yield _shadow_of_sand(results)
    yield _polar("figure_9_05", results, ("ps3a", "ps3b", "ps3c", "ps3d"))
    shares: list[Row] = [
        (name, *(100.0 * float((maps.shadows[name] == count).mean()) for count in range(5)))
        for name in _SHOWN_SOLVERS
    ]
    columns = ("map", *(f"{count}_lights_pct" for count in range(5)))
    scale = plots.Scale((0.0, 4.0), "cividis", "lights in shadow")
    yield _maps("figure_9_07", columns, shares, maps.shadows, scale, digits=1)
    top = float(np.percentile(np.abs(maps.relief[TRUTH]), 99.5))
    yield _maps(
        "figure_9_08",
        ("solver", "rms_error_p", "rms_error_q"),
        [(name, *maps.errors[name][:2]) for name in plan.SOLVERS],
        maps.relief,
        plots.Scale((-top, top), "gray", "relative height, px"),
        {name: float(np.hypot(*errors[:2])) for name, errors in maps.errors.items()},
    )
    albedo_errors = {name: errors[2] for name, errors in maps.errors.items()}
    yield _maps(
        "figure_9_09",
        ("solver", "rms_error_albedo"),
        [(name, albedo_errors[name]) for name in plan.SOLVERS],
        maps.albedo,
        plots.Scale((0.0, 1.2), "gray", "albedo"),
        albedo_errors,
    )
    yield _polar("figure_9_10", results, (*plan.SOLVERS[1:], TRUTH))


def _shadow_by_texture(results: Results) -> Exhibit:
    shares = results.shadow_shares
    slants_deg = sorted({slant_deg for _, slant_deg in shares})
    lines = [
        plots.Line(
            name, slants_deg, [100.0 * shares[name, slant_deg][0] for slant_deg in slants_deg]
        )
        for name in dict.fromkeys(name for name, _ in shares)
    ]
    columns = [f"{line.label}_pct" for line in lines]
    return _shadow("figure_9_02", columns, "light at tilt 0", lines)


def _shadow_of_sand(results: Results) -> Exhibit:
    slants_deg = sorted(slant_deg for name, slant_deg in results.shadow_shares if name == "sand")
    shares = np.array([results.shadow_shares["sand", slant_deg] for slant_deg in slants_deg])
    thesis = [_THESIS_SAND_SHADOW_PCT.get(round(slant_deg)) for slant_deg in slants_deg]
    lines = [
        plots.Line(f"tilt {tilt_deg:g}", slants_deg, values)
        for tilt_deg, values in zip(SHADOW_TILTS_DEG, (100.0 * shares.T).tolist(), strict=True)
    ]
    lines.append(plots.Line("thesis, tilt 0", slants_deg, thesis, style="x", colour="#000000"))
    tilts = [f"tilt_{tilt_deg:g}_pct" for tilt_deg in SHADOW_TILTS_DEG]
    return _shadow("figure_9_03", [*tilts, "thesis_tilt_0_pct"], "sand", lines)


def _shadow(key: str, columns: list[str], title: str, lines: list[plots.Line]) -> Exhibit:
    return Exhibit(
        key,
        ("slant_deg", *columns),
        list(zip(lines[0].x, *(line.y for line in lines), strict=True)),
        draw=partial(
            plots.draw_lines,
            panels=((title, lines),),
            x_label="slant, degrees",
            y_label="shadow count, % of pixels",
        ),
        size_in=(6.5, 4.0),
    )


def _polar(key: str, results: Results, solvers: Sequence[str]) -> Exhibit:
    polar = results.polar
    orientations_deg = sorted(polar)
    panels = [
        (SOLVER_TITLES[solver], [(f"{deg:g}°", polar[deg][solver]) for deg in orientations_deg])
        for solver in solvers
    ]
    ratios = []
    for solver in dict.fromkeys((*solvers, TRUTH)):
        lobes = [max(polar[deg][solver]) for deg in orientations_deg]
        ratios.append(f"{SOLVER_TITLES[solver]} {max(lobes) / min(lobes):.2f}")
    rows: list[Row] = [
        (solver, deg, 2.0 * index, value)
        for solver in solvers
        for deg in orientations_deg
        for index, value in enumerate(polar[deg][solver])
    ]
    return Exhibit(
        key,
        ("solver", "orientation_deg", "angle_deg", "m"),
        rows,
        draw=partial(plots.draw_polar, panels=panels),
        size_in=(2.6 * len(panels) + 0.6, 3.7),
        values={"slant": _SLANT, "ratios": ", ".join(ratios)},
    )


def _maps(
    key: str,
    columns: Sequence[str],
    rows: list[Row],
    maps: Mapping[str, npt.NDArray[np.generic]],
    scale: plots.Scale,
    errors: Mapping[str, float] | None = None,
    digits: int = 3,
) -> Exhibit:
    """Maps of the solvers and the truth; the caption has the ratios of errors to those of PS4."""
    values = {"slant": _SLANT}
    if errors is not None:
        values["gain_ps4"] = f"{errors['ps3a'] / errors['ps4']:.1f}"
        values["gain_best"] = f"{errors['ps3a'] / errors[plan.BEST_SOLVER]:.1f}"
    titled_maps = [(SOLVER_TITLES[name], maps[name]) for name in _SHOWN_SOLVERS]
    draw = partial(plots.draw_maps, maps=titled_maps, scale=scale)
    return Exhibit(key, columns, rows, draw, (11.0, 3.0), digits, values)
