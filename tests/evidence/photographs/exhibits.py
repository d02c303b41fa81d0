"""Tables and pictures of solved photographs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from capture.chapter.output import Exhibit, Row
from capture.maps import pictures
from capture.maps.pictures import Picture
from classify import Method

from .photograph_set import PhotographSet
from .recognition import PATCH_PX, Recognition
from .scores import Score, solve_pick

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DIFFERENT = 1.02  # ratio of two mean errors that counts as worse
_MAP_IN = 2.0  # side of one map
_SHOWN: Method = "ps4_robust"


def photograph_exhibits(
    sets: Sequence[PhotographSet], scores: Sequence[Score], recognised: Sequence[Recognition]
) -> Iterator[Exhibit]:
    """The table by method, the table of all picks, recognition, and the pictures."""
    yield _summary(scores)
    yield _picks(scores)
    if recognised:
        yield _recognition(recognised)
    yield _maps(sets)


def _summary(scores: Sequence[Score]) -> Exhibit:
    least_squares = {
        (each.name, each.pick, each.planar): each
        for each in scores
        if each.method == "least_squares"
    }
    groups: dict[tuple[str, str], list[Score]] = {}
    for each in scores:
        groups.setdefault((each.name, _title(each)), []).append(each)
    for each in scores:
        if not each.planar:
            groups.setdefault(("all", _title(each)), []).append(each)
    rows: list[Row] = []
    for (name, title), group in groups.items():
        ratios = [
            each.mean_pct / base.mean_pct
            for each in group
            if (base := least_squares[each.name, each.pick, each.planar]).mean_pct
            if each.mean_pct is not None
        ]
        rows.append((
            name, title, len(group),
            _mean([each.median_pct for each in group]),
            _mean([each.mean_pct for each in group]),
            sum(ratio > _DIFFERENT for ratio in ratios) if ratios else None,
            sum(ratio < 1.0 / _DIFFERENT for ratio in ratios) if ratios else None,
            _mean([each.valid_pct for each in group]),
            max(each.changed_pct for each in group),
            None if name == "all" else _mean([each.reference_r for each in group]),
        ))  # fmt: skip
    return Exhibit(
        "photographs",
        (
            "photographs", "method", "picks", "median error, %", "mean error, %",
            "worse than least squares", "better", "valid, %", "changed by turning, %",
            "r of p with the reference",
        ),
        rows,
        digits=2,
    )  # fmt: skip


def _title(score: Score) -> str:
    return f"{score.method}{', planar' * score.planar}"


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _picks(scores: Sequence[Score]) -> Exhibit:
    rows: list[Row] = [
        (
            each.name, " ".join(map(str, each.pick)), _title(each),
            each.median_pct, each.mean_pct, each.valid_pct, each.changed_pct, each.reference_r,
        )
        for each in scores
    ]  # fmt: skip
    return Exhibit(
        "photographs_picks",
        (
            "photographs", "pick", "method", "median error, %", "mean error, %", "valid, %",
            "changed by turning, %", "r of p with the reference",
        ),
        rows,
        digits=2,
    )  # fmt: skip


def _recognition(recognised: Sequence[Recognition]) -> Exhibit:
    groups: dict[str, list[Recognition]] = {}
    for name_of in (attrgetter("kind"), attrgetter("trial.label"), lambda _: "all"):
        for each in recognised:
            groups.setdefault(name_of(each), []).append(each)
    rows: list[Row] = []
    for name, group in groups.items():
        trials = [each.trial for each in group]
        right = sum(each.is_correct for each in trials)
        refused = sum(each.match.label is None for each in trials)
        shares = (right, refused, len(trials) - right - refused)
        matches = [match for each in group for match in each.unknown]
        accepted = [match for match in matches if match.label is not None]
        taken_for = Counter(match.label for match in accepted)
        unmarked = sum(match.class_uniformity != "no texture" for match in accepted)
        class_is = {each.match.class_uniformity for each in trials if each.match.nearest == name}
        rows.append((
            name, len(trials), *(100.0 * each / len(trials) for each in shares),
            len(matches), 100.0 * len(accepted) / len(matches), 100.0 * unmarked / len(matches),
            next(iter(class_is), None),
            ", ".join(label for label, _ in taken_for.most_common()) or None,
        ))  # fmt: skip
    return Exhibit(
        "photographs_recognition",
        (
            "tests", "patches", "right, %", "refused, %", "wrong, %",
            "matches without the object", "accepted, %", "by classes not marked, %",
            "as a class", "taken for",
        ),
        rows,
        values={"side_px": PATCH_PX},
    )  # fmt: skip


def _maps(sets: Sequence[PhotographSet]) -> Exhibit:
    shown = {
        f"{each.name}{', planar' * planar}": _pictures(each, planar)
        for each in sets
        for planar in ((False, True) if each.reference_p is not None else (False,))
    }
    columns = len(next(iter(shown.values())))
    return Exhibit(
        "photographs_maps",
        ("photographs",),
        [(name,) for name in shown],
        draw=partial(_draw, shown=shown),
        size_in=(columns * _MAP_IN, len(shown) * _MAP_IN),
    )


def _pictures(photographs: PhotographSet, planar: bool) -> Mapping[str, Picture]:
    """Maps of the first pick; outside the object they are white."""
    pick = photographs.picks()[0]
    surface = solve_pick(photographs, pick, _SHOWN, planar)
    mean = photographs.images[list(pick)].mean(axis=0)
    bright = np.maximum(surface.albedo, 1e-6)
    maps = {
        "mean of four": pictures.grey(mean),
        "albedo": pictures.grey(surface.albedo),
        "normals": pictures.normal_map(surface.normals),
        "relief": pictures.shaded(surface.normals),
        "residual / albedo": pictures.grey(surface.residual / bright, top=0.2),
        "light left out": pictures.coloured(surface.dropped, pictures.dropped_colours(len(pick))),
    }
    outside = ~photographs.mask
    for picture in maps.values():
        picture[outside] = 255
    return maps


def _draw(figure: Figure, shown: Mapping[str, Mapping[str, Picture]]) -> None:
    columns = len(next(iter(shown.values())))
    axes = figure.subplots(len(shown), columns, squeeze=False)
    for row, (name, maps) in zip(axes, shown.items(), strict=True):
        for ax, (title, picture) in zip(row, maps.items(), strict=True):
            ax.imshow(picture, interpolation="antialiased")
            ax.set_xticks([])
            ax.set_yticks([])
            ax.set_frame_on(False)
            if ax in axes[0]:
                ax.set_title(title, fontsize=9)
        row[0].set_ylabel(name, fontsize=9)
