"""Tables and pictures of detected defects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from capture.chapter.output import Exhibit, Row
from capture.chapter.plots import Line, draw_lines
from classify.confidence import share_at_most
from rig.config.simulation import RELIEF_KINDS, DefectKind

from .detectors import DETECTORS
from .examples import Example, draw_examples
from .measure import System, TextureResult
from .plan import FALSE_ALARM_RATE, KINDS, STAIN, DefectCase, DefectPlan
from .scores import auroc

_GROUPS: tuple[tuple[str, tuple[DefectKind, ...]], ...] = (
    ("relief", RELIEF_KINDS),
    *((kind, (kind,)) for kind in KINDS),
)
_COLOURS = ("#1b7837", "#d6604d", "#4393c3", "#762a83")
_PANEL_IN = 2.0


def defect_exhibits(plan: DefectPlan, results: Sequence[TextureResult]) -> Iterator[Exhibit]:
    """Make the exhibits in the order of the page."""
    values = {
        "textures": len(plan.textures),
        "good": plan.good,
        "sizes": ", ".join(f"{each:g}" for each in plan.sizes_px),
        "depths": ", ".join(f"{each:g}" for each in plan.depths_px),
        "contrasts": ", ".join(f"{100 * each:g}" for each in plan.contrasts),
        "rate": f"{100 * FALSE_ALARM_RATE:g}",
        "taught": max(plan.taught),
    }
    systems = [System(name, count) for count in plan.taught for name in DETECTORS]
    yield _kinds(systems, results, values)
    yield _false_alarms(systems, results, values)
    yield _strengths(plan, results, values)
    yield _textures(plan, results, values)
    yield _examples([each.example for each in results if each.example is not None], values)


def _kinds(
    systems: Sequence[System], results: Sequence[TextureResult], values: dict[str, object]
) -> Exhibit:
    rows: list[Row] = []
    for title, kinds in _GROUPS:
        of_kinds = [b for r in results for case, b in r.bounds.items() if case.kind in kinds]
        bound = (
            (
                float(np.median([b.d_prime for b in of_kinds])),
                _mean_pct(b.is_found for b in of_kinds),
            )
            if of_kinds
            else (None, None)
        )
        for system in systems:
            measured = [each.measured[system] for each in results]
            rows.append((
                title, system.taught, system.detector,
                _mean_pct(each.of_kinds(kinds) > 1.0 for each in measured),
                _mean_pct(each.good > 1.0 for each in measured),
                _mean_pct(each.of_kinds(kinds) > each.good.max() for each in measured),
                *bound,
                _mean_pct(auroc(each.of_kinds(kinds), each.good) for each in measured),
                _mean_pct(each.pixel_auroc[kind] for each in measured for kind in kinds),
                _mean_pct(each.aupro[kind] for each in measured for kind in kinds),
            ))  # fmt: skip
    return Exhibit(
        "defects",
        (
            "defect", "parts taught", "detector", "found, %", "false alarms, %",
            "found above all good parts, %", "median d'", "bound on that, %", "AUROC of parts, %",
            "of pixels, %", "AUPRO, %",
        ),
        rows,
        values=values,
    )  # fmt: skip


def _false_alarms(
    systems: Sequence[System], results: Sequence[TextureResult], values: dict[str, object]
) -> Exhibit:
    rows: list[Row] = []
    groups = {"synthetic": [r for r in results if r.synthetic]}
    groups |= {"materials": [r for r in results if not r.synthetic], "all": list(results)}
    for title, group in groups.items():
        for system in systems:
            good = np.concatenate([each.measured[system].good for each in group])
            alarms = int(np.count_nonzero(good > 1.0))
            bound = 100.0 * share_at_most(alarms, len(good))
            rows.append((
                title, system.taught, system.detector, len(good), alarms,
                100.0 * alarms / len(good), bound,
            ))  # fmt: skip
    columns = ("good parts", "with an alarm", "%", "at most, %, at 95 % confidence")
    return Exhibit(
        "defects_false_alarms", ("textures", "parts taught", "detector", *columns), rows,
        values=values,
    )  # fmt: skip


def _strengths(
    plan: DefectPlan, results: Sequence[TextureResult], values: dict[str, object]
) -> Exhibit:
    """Share found against depth or contrast, with the most parts taught."""
    systems = [System(name, max(plan.taught)) for name in DETECTORS]
    measured = {system: [r.measured[system] for r in results] for system in systems}

    def found(kinds: Iterable[DefectKind], size_px: float, strength: float | None) -> list[float]:
        cases = [DefectCase(kind, size_px, strength) for kind in kinds]
        return [
            _mean_pct(each.defective[case] > each.good.max() for each in group for case in cases)
            for group in measured.values()
        ]

    rows: list[Row] = [
        (case.kind, case.size_px, case.strength, *found([case.kind], *case[1:]))
        for case in plan.cases
    ]
    panels = []
    for title, kinds, strengths in (
        ("relief", RELIEF_KINDS, plan.depths_px),
        ("stain", STAIN, plan.contrasts),
    ):
        for size_px in plan.sizes_px:
            shares = [found(kinds, size_px, strength) for strength in strengths]
            lines = [
                Line(system.detector, strengths, [row[number] for row in shares], colour=colour)
                for number, (system, colour) in enumerate(zip(systems, _COLOURS, strict=False))
            ]
            panels.append((f"{title}, {size_px:g} px", lines))
    return Exhibit(
        "defects_strengths",
        ("defect", "size, px", "depth, px, or contrast", *(f"{name}, %" for name in DETECTORS)),
        rows,
        draw=partial(
            draw_lines, panels=panels, x_label="depth, px, or contrast", y_label="found, %"
        ),
        size_in=(_PANEL_IN * len(panels), 3.0),
        values=values,
    )


def _textures(
    plan: DefectPlan, results: Sequence[TextureResult], values: dict[str, object]
) -> Exhibit:
    systems = [System(name, max(plan.taught)) for name in DETECTORS]
    rows: list[Row] = []
    for result in results:
        measured = [result.measured[system] for system in systems]
        rows.append((
            result.texture, f"{result.rms_slope:.2f}",
            *(_mean_pct([each.good > 1.0]) for each in measured),
            *(100.0 * auroc(each.of_kinds(RELIEF_KINDS), each.good) for each in measured),
            *(100.0 * auroc(each.of_kinds(STAIN), each.good) for each in measured),
        ))  # fmt: skip
    heads = ("false alarms", "AUROC, relief", "AUROC, stain")
    return Exhibit(
        "defects_textures",
        ("texture", "rms slope", *(f"{head}: {name}, %" for head in heads for name in DETECTORS)),
        rows,
        values=values,
    )


def _examples(examples: Sequence[Example], values: dict[str, object]) -> Exhibit:
    columns = ("texture", "defect", *DETECTORS)
    rows: list[Row] = [
        (each.texture, each.defect, *(float(np.nanmax(score)) for score in each.scores.values()))
        for each in examples
    ]
    return Exhibit(
        "defects_examples",
        columns,
        rows,
        draw=partial(draw_examples, examples=examples),
        size_in=(_PANEL_IN * (1 + len(DETECTORS)), _PANEL_IN * len(examples) + 0.4),
        digits=2,
        values=values,
    )


def _mean_pct(shares: Iterable[npt.ArrayLike]) -> float:
    """Mean of shares, or of whether each of several parts is found, in percent."""
    return 100.0 * float(np.mean(np.stack([np.asarray(each, np.float64) for each in shares])))
