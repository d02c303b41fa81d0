"""Drawing of exhibits on a matplotlib figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from capture.base.chart import curve_colour
from classify.base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {"ps3a": "#d6604d", "ps4": "#4393c3", "ps4_robust": "#1b7837"}
"""Colours of the solvers, in every figure."""


@dataclass(frozen=True)
class Line:
    """A curve with a name; `style` and `colour` as in matplotlib."""

    label: str
    x: Sequence[float]
    y: Sequence[float | None]
    style: str = "-o"
    colour: str | None = None


class Scale(NamedTuple):
    """Range of values, colours of matplotlib, and label of the colour bar."""

    value_range: tuple[float, float]
    colours: str
    label: str


def draw_lines(
    figure: Figure,
    panels: Sequence[tuple[str, Sequence[Line]]],
    x_label: str,
    y_label: str,
    *,
    levels: Sequence[tuple[float, str]] = (),
) -> None:
    """Draw the curves of each titled panel; `levels` are (value, name) of horizontal lines."""
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, (title, lines) in zip(axes, panels, strict=True):
        for value, name in levels:
            ax.axhline(value, color="#999999", linewidth=0.8, linestyle=":")
            ax.annotate(
                name, (0.99, value), xycoords=("axes fraction", "data"), ha="right", va="bottom",
                fontsize=7, color="#666666",
            )  # fmt: skip
        for number, line in enumerate(lines):
            y = [np.nan if value is None else value for value in line.y]
            ax.plot(
                line.x, y, line.style, label=line.label, markersize=4, linewidth=1.4,
                color=line.colour or curve_colour(number),
            )  # fmt: skip
        ax.set_title(title, fontsize=10)
        ax.set_xlabel(x_label)
        ax.grid(visible=True, color="#eeeeee")
    axes[0].set_ylabel(y_label)
    _legend(figure, axes[-1])


def draw_bars(
    figure: Figure,
    names: Sequence[str],
    panels: Sequence[tuple[str, Sequence[tuple[str, str, Sequence[float | None]]]]],
) -> None:
    """Draw accuracies in percent as bars, of panels with (label, colour, values by name)."""
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    positions = np.arange(len(names))
    for ax, (title, groups) in zip(axes, panels, strict=True):
        height = 0.8 / len(groups)
        for number, (label, colour, values) in enumerate(groups):
            widths = [0.0 if value is None else value for value in values]
            offset = (number - (len(groups) - 1) / 2.0) * height
            ax.barh(positions + offset, widths, height, label=label, color=colour)
        ax.set_title(title, fontsize=10)
        ax.set_xlabel("accuracy, %")
        ax.grid(visible=True, axis="x", color="#eeeeee")
        ax.set_axisbelow(True)
    axes[0].set_yticks(positions, names, fontsize=8)
    axes[0].invert_yaxis()
    _legend(figure, axes[-1])


def draw_polar(
    figure: Figure, panels: Sequence[tuple[str, Sequence[tuple[str, Sequence[float]]]]]
) -> None:
    """Draw polar spectra over 180 degrees twice around the circle, all on one scale."""
    top = max(max(values) for _, curves in panels for _, values in curves)
    for number, (title, curves) in enumerate(panels):
        ax: Any = figure.add_subplot(1, len(panels), number + 1, projection="polar")
        for index, (label, values) in enumerate(curves):
            around = np.concatenate([values, values, values[:1]]) / top
            angles = np.linspace(0.0, 2.0 * np.pi, len(around))
            ax.plot(angles, around, linewidth=1.1, label=label, color=curve_colour(index))
        ax.set_title(title, fontsize=10)
        ax.set_ylim(0.0, 1.05)
        ax.set_yticklabels([])
        ax.tick_params(labelsize=7)
    _legend(figure, figure.axes[-1])


def draw_maps(figure: Figure, maps: Sequence[tuple[str, Array]], scale: Scale) -> None:
    """Draw titled maps side by side on one scale of colours."""
    axes = figure.subplots(1, len(maps), squeeze=False)[0]
    low, high = scale.value_range
    for ax, (title, values) in zip(axes, maps, strict=True):
        image = ax.imshow(values, cmap=scale.colours, vmin=low, vmax=high, interpolation="nearest")
        ax.set_title(title, fontsize=9)
        ax.set_axis_off()
    figure.colorbar(image, ax=axes, shrink=0.8, label=scale.label)


def _legend(figure: Figure, ax: Any) -> None:
    """Put the legend below all axes, where it hides nothing."""
    handles, labels = ax.get_legend_handles_labels()
    columns = min(len(labels), max(1, int(figure.get_figwidth() / 2.4)))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=8)
