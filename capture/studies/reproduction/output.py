"""The files of a reproduction: CSV and PNG of each exhibit, all numbers as JSON, one page."""

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

_DPI = 130


def write_exhibit(exhibit: Exhibit, folder: Path) -> bytes:
    """Write KEY.csv and KEY.png; returns the picture."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(exhibit.columns)
    writer.writerows(exhibit.rows)
    write_text(folder / f"{exhibit.key}.csv", text.getvalue())
    picture = _drawn(exhibit)
    with durable_file(folder / f"{exhibit.key}.png") as temporary:
        temporary.write_bytes(picture)
    return picture


def write_numbers(exhibits: Sequence[Exhibit], about: dict[str, Any], path: Path) -> None:
    """All exhibits in one JSON file."""
    contents = about | {
        "exhibits": {
            each.key: {"title": each.title, "columns": each.columns, "rows": each.rows}
            for each in exhibits
        }
    }
    write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """A text file, whole or not at all."""
    with durable_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _drawn(exhibit: Exhibit) -> bytes:
    # Figures without pyplot: no window system is asked, and nothing is kept.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    draw, size_in = exhibit.draw, exhibit.size_in
    if draw is None:
        table = (exhibit.columns, exhibit.rows, exhibit.digits)
        size_in = plots.table_size_in(*table)
        figure = Figure(figsize=size_in)
        plots.draw_table(figure, *table)
    else:
        figure = Figure(figsize=size_in, layout="constrained")
        draw(figure)
    FigureCanvasAgg(figure)
    picture = io.BytesIO()
    # Without the version of matplotlib in it, the same numbers make the same file.
    figure.savefig(picture, format="png", dpi=_DPI, metadata={"Software": None})
    return picture.getvalue()
