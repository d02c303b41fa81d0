"""The files of a reproduction: CSV and PNG of each exhibit, all numbers as JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from classify.durable_file import durable_file

from . import plots
from .exhibit import Exhibit

__all__ = ["write_exhibit", "write_numbers", "write_text"]

_DPI = 130  # text of 7 points stays readable on the page


def write_exhibit(exhibit: Exhibit, folder: Path) -> bytes:
    """Write KEY.csv and KEY.png; returns the PNG."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(exhibit.columns)
    writer.writerows(exhibit.rows)
    write_text(folder / f"{exhibit.key}.csv", text.getvalue())
    png = _drawn(exhibit)
    with durable_file(folder / f"{exhibit.key}.png") as temporary:
        temporary.write_bytes(png)
    return png


def write_numbers(exhibits: Sequence[Exhibit], about: dict[str, Any], path: Path) -> None:
    """Write the numbers of all exhibits into one JSON file."""
    contents = about | {
        "exhibits": {
            each.key: {"title": each.title, "columns": each.columns, "rows": each.rows}
            for each in exhibits
        }
    }
    write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text file as a whole or not at all."""
    with durable_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _drawn(exhibit: Exhibit) -> bytes:
    # Without pyplot: it would look for a window system and keep every figure in memory.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if exhibit.draw is None:
        figure = Figure()
        plots.draw_table(figure, exhibit.columns, exhibit.rows, exhibit.digits)
    else:
        figure = Figure(figsize=exhibit.size_in, layout="constrained")
        exhibit.draw(figure)
    FigureCanvasAgg(figure)
    png = io.BytesIO()
    # Without the version of matplotlib in it, equal numbers give equal files.
    figure.savefig(png, format="png", dpi=_DPI, metadata={"Software": None})
    return png.getvalue()
