"""Figures of a report: addresses of SVG images, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from capture.base.page import curve_colour, svg_uri
from classify import Spectra
from classify.lighting import orientation_near

from .journal import SetEntry
from .report_analysis import Separation

_MARKS = "osD^v<>Ph*"
_GRID = "#dddddd"


def levels_figure(entries: Sequence[SetEntry]) -> str:
    """Draw the level of each light over time, relative to the first set of each specimen."""
    figure, axes = _figure(7.0, 2.6)
    first: dict[tuple[str, int], tuple[float, ...]] = {}
    # A session may be resumed on a rig with another number of lights.
    curves: dict[int, list[tuple[float, float]]] = {}
    for entry in entries:
        if entry.measures is None or entry.captured_utc is None:
            continue
        levels = entry.measures.led_levels
        base = first.setdefault((entry.piece, len(levels)), levels)
        days = datetime.fromisoformat(entry.captured_utc).timestamp() / 86_400.0
        for light, value in enumerate(100.0 * np.array(levels) / np.maximum(base, 1e-6)):
            curves.setdefault(light, []).append((days, value))
    for light, curve in sorted(curves.items()):
        axes.plot(
            *zip(*curve, strict=True),
            ".-", linewidth=0.8, color=curve_colour(light), label=f"LED {light}",
        )  # fmt: skip
    axes.set_ylabel("% of the first set")
    axes.xaxis_date()
    if curves:
        axes.legend(fontsize=7, ncols=4, frameon=False)
    figure.autofmt_xdate()
    return svg_uri(figure)


def orientations_figure(entries: Sequence[SetEntry]) -> str:
    """Draw how far the estimated orientation of each set is from the entered one."""
    figure, axes = _figure(7.0, 2.6)
    for number, specimen in enumerate(dict.fromkeys(entry.piece for entry in entries)):
        points = [
            (entry.entered_deg, off_deg)
            for entry in entries
            if entry.piece == specimen and (off_deg := _orientation_error_deg(entry)) is not None
        ]
        if points:
            axes.plot(
                *zip(*points, strict=True), _mark(number), markersize=4, color=curve_colour(number),
                label=specimen,
            )  # fmt: skip
    axes.axhline(0.0, color=_GRID, zorder=0)
    axes.set_xlabel("entered, degrees")
    axes.set_ylabel("estimated - entered")
    _legend(axes)
    return svg_uri(figure)


def _orientation_error_deg(entry: SetEntry) -> float | None:
    """Estimated less entered orientation, [-90, 90); None where none was estimated."""
    entered_deg = entry.entered_deg
    if entry.measures is None or entry.measures.estimated_deg is None or entered_deg is None:
        return None
    # Folded anew, because the entered orientation may have been corrected.
    return orientation_near(entry.measures.estimated_deg, entered_deg) - entered_deg


def matrix_figure(separation: Separation) -> str:
    """Draw the dissimilarities of the specimens, in the order of their dendrogram."""
    order = separation.tree.order
    names = [separation.specimens[index] for index in order]
    side = min(3.0 + 0.16 * len(names), 10.0)
    figure = Figure(figsize=(2.0 * side, side), layout="constrained")
    matrix_axes, tree_axes = figure.subplots(1, 2, width_ratios=(3, 2))
    shown = separation.dissimilarities[np.ix_(order, order)]
    image = matrix_axes.imshow(shown, cmap="viridis")
    matrix_axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    matrix_axes.set_yticks(range(len(names)), names, fontsize=7)
    figure.colorbar(image, ax=matrix_axes, shrink=0.7, label="distance")
    for branch in separation.tree.branches:
        tree_axes.plot(branch[:, 0], branch[:, 1], color=curve_colour(0), linewidth=1.0)
    tree_axes.set_ylim(len(names) - 0.5, -0.5)
    tree_axes.set_yticks(range(len(names)), names, fontsize=7)
    tree_axes.yaxis.tick_right()
    tree_axes.set_xlabel("distance at which groups join")
    tree_axes.invert_xaxis()
    return svg_uri(figure)


def map_figure(separation: Separation) -> str:
    """Draw all sets in a plane in which near sets look alike."""
    figure, axes = _figure(7.0, 5.0)
    for number, specimen in enumerate(separation.specimens):
        chosen = [entry.piece == specimen for entry in separation.entries]
        axes.plot(
            *separation.places[chosen].T, _mark(number), markersize=5, color=curve_colour(number),
            label=specimen, alpha=0.8,
        )  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    _legend(axes)
    return svg_uri(figure)


def spectrum_figure(spectra: Spectra) -> str:
    """Draw the polar spectra of gradient and albedo of a specimen."""
    figure = Figure(figsize=(2.0, 2.0), layout="constrained")
    axes = figure.add_subplot(projection="polar")
    for number, values in enumerate(spectra.polar):
        around = np.concatenate([values, values, values[:1]]) / max(float(values.max()), 1e-12)
        angles = np.linspace(0.0, 2.0 * np.pi, len(around))
        axes.plot(angles, around, color=curve_colour(number), linewidth=1.0)
    axes.set_yticklabels([])
    axes.tick_params(labelsize=6)
    return svg_uri(figure)


def _figure(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    axes = figure.subplots()
    axes.grid(visible=True, color=_GRID, linewidth=0.5)
    axes.tick_params(labelsize=7)
    return figure, axes


def _legend(axes: Axes) -> None:
    handles, _ = axes.get_legend_handles_labels()
    if 0 < len(handles) <= 40:
        axes.legend(fontsize=6, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _mark(number: int) -> str:
    """Return a mark: with the colours it tells 40 specimens apart."""
    return _MARKS[number % len(_MARKS)]
