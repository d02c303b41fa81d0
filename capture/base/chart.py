"""Charts of pages and reports, drawn by matplotlib, which is loaded with the first chart."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# On a telephone, which shows a figure of this width on 358 px, these letters have 10 px.
CHART_WIDTH_IN, LETTERS_PT = 4.4, 9
GRID = "#dddddd"
_COLOURS = ("#2166ac", "#b2182b", "#1b7837", "#762a83", "#e08214", "#01665e", "#555555", "#c51b7d")


def chart_axes(
    height_in: float,
    width_in: float = CHART_WIDTH_IN,
    margins_in: tuple[float, float, float, float] | None = None,
) -> tuple[Figure, Axes]:
    """Return an empty figure, and axes with margins left, right, top and bottom."""
    # Without given margins, matplotlib measures all texts, which takes twice the time.
    # Without pyplot: it would look for a window system and keep every figure in memory.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout=None if margins_in else "constrained")
    if margins_in is None:
        axes = figure.subplots()
    else:
        left, right, top, bottom = margins_in
        width, height = 1 - (left + right) / width_in, 1 - (top + bottom) / height_in
        axes = figure.add_axes((left / width_in, bottom / height_in, width, height))
    axes.set_axisbelow(True)
    axes.grid(visible=True, color=GRID, linewidth=0.5)
    axes.tick_params(labelsize=LETTERS_PT)
    axes.xaxis.label.set_fontsize(LETTERS_PT)
    axes.yaxis.label.set_fontsize(LETTERS_PT)
    return figure, axes


def png_of(figure: Figure, dpi: float) -> bytes:
    """Return a figure as a PNG file."""
    png = io.BytesIO()
    # Without the version of matplotlib in it, equal numbers give equal files.
    figure.savefig(png, format="png", dpi=dpi, metadata={"Software": None})
    return png.getvalue()


def svg_uri(figure: Figure) -> str:
    """Return a figure as the data URI of an SVG image; inline images could have equal ids."""
    text = io.BytesIO()
    # A date would make two equal pages differ.
    figure.savefig(text, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(text.getvalue()).decode("ascii")


def curve_colour(number: int) -> str:
    """Return the colour of a curve, numbered from 0; they repeat after eight."""
    return _COLOURS[number % len(_COLOURS)]
