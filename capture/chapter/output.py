"""The files of a reproduction: CSV, PNG, JSON and one HTML page."""

import base64
import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from string import Template

from markupsafe import Markup

from capture.base.console import progress
from capture.base.page import rendered
from classify.base.durable_file import durable_file

from . import plots
from .exhibit import Exhibit, Text, as_text, read_texts

_DPI = 130  # text of 7 points stays readable on the page
# Longer lists of numbers are in the CSV files only.
_SHOWN_ROWS = 60
_QUICK = (
    " <b>Quick version:</b> fewer textures and tests, or smaller frames, than without "
    "<code>--quick</code>; one percent may be a single test."
)


_Table = list[list[tuple[str, str]]]


@dataclass(frozen=True)
class About:
    """Name of a page, the HTML file of its introduction, and what its numbers are.

    The texts of the exhibits are in ``notes.toml`` beside the introduction.
    """

    page: str
    introduction: Path
    simulated: bool
    quick: bool = False

    @property
    def texts(self) -> dict[str, Text]:
        """Texts of the exhibits, by their keys."""
        return read_texts(self.introduction.with_name("notes.toml"))


def _write_exhibit(exhibit: Exhibit, folder: Path) -> bytes:
    """Write KEY.csv and KEY.png; returns the PNG."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(exhibit.columns)
    writer.writerows(exhibit.rows)
    _write_text(folder / f"{exhibit.key}.csv", text.getvalue())
    png = _drawn(exhibit)
    with durable_file(folder / f"{exhibit.key}.png") as temporary:
        temporary.write_bytes(png)
    return png


def write_page(
    exhibits: Sequence[Exhibit], facts: Mapping[str, str], about: About, folder: Path
) -> Path:
    """Write the files of all exhibits, `results.json` and the page; returns the page."""
    drawn = [
        (each, _write_exhibit(each, folder)) for each in progress(exhibits, len(exhibits), "draw")
    ]
    _write_numbers(exhibits, about, folder / "results.json")
    path = folder / f"{about.page}.html"
    _write_text(path, page(drawn, facts, about))
    return path


def _write_numbers(exhibits: Sequence[Exhibit], about: About, path: Path) -> None:
    """Write the numbers of all exhibits into one JSON file."""
    texts = about.texts
    contents = {
        "version": version("ps4rig"),
        "simulated": about.simulated,
        "quick": about.quick,
        "exhibits": {
            each.key: {"title": texts[each.key].title, "columns": each.columns, "rows": each.rows}
            for each in exhibits
        },
    }
    _write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def _write_text(path: Path, text: str) -> None:
    """Write a text file as a whole or not at all."""
    with durable_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def page(exhibits: Sequence[tuple[Exhibit, bytes]], facts: Mapping[str, str], about: About) -> str:
    """HTML of the page from each exhibit and its PNG, in this order."""
    texts = about.texts
    sections: dict[str, list[tuple[Exhibit, Text, str, _Table]]] = {}
    for exhibit, png in exhibits:
        text = exhibit.text_from(texts)
        shown = exhibit, text, base64.b64encode(png).decode("ascii"), _table(exhibit)
        sections.setdefault(text.section, []).append(shown)
    introduction = Template(about.introduction.read_text(encoding="utf-8"))
    return rendered(
        "chapter/page.html",
        introduction=Markup(introduction.substitute(quick=_QUICK if about.quick else "")),
        facts=facts.items(),
        sections=sections,
    )


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


def _table(exhibit: Exhibit) -> _Table:
    """The rows as text, header first, each cell with the kind of its column."""
    if exhibit.draw is not None and len(exhibit.rows) > _SHOWN_ROWS:
        return []
    columns = list(zip(*exhibit.rows, strict=True)) or [()] * len(exhibit.columns)
    kinds = []
    for name, cells in zip(exhibit.columns, columns, strict=True):
        numeric = all(isinstance(cell, int | float | None) for cell in cells)
        kinds.append("given" if name.startswith("thesis") else "number" if numeric else "")
    return [
        [(kind, as_text(cell, exhibit.digits)) for kind, cell in zip(kinds, row, strict=True)]
        for row in (exhibit.columns, *exhibit.rows)
    ]
