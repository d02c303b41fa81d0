"""Figures and tables of a reproduction, and their files: CSV, PNG, JSON and one HTML page."""

from __future__ import annotations

import base64
import csv
import io
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, NamedTuple

from markupsafe import Markup

from capture.base.chart import png_of
from capture.base.console import progress
from capture.base.page import rendered
from classify.base.durable_file import durable_file, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell = str | int | float | None
Row = tuple[Cell, ...]


class _Text(NamedTuple):
    """Heading of the section, title, and paragraphs on what is shown and what the thesis has."""

    section: str
    title: str
    notes: list[str]


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A figure with its numbers, or a table if `draw` is None."""

    key: str  # stem of its files, and name of its text in notes.toml
    columns: Sequence[str]  # each name includes the unit
    rows: list[Row]
    draw: Callable[[Figure], None] | None = None
    size_in: tuple[float, float] = (8.0, 4.0)  # width and height of the drawing
    digits: int = 1  # decimals in a table
    values: Mapping[str, object] = field(default_factory=dict)  # replace the $names in the text

    def text_from(self, texts: Mapping[str, _Text]) -> _Text:
        """Text beside the exhibit, with its values."""
        section, title, notes = texts[self.key]
        filled = [" ".join(Template(note).substitute(self.values).split()) for note in notes]
        return _Text(section, title, filled)


_DPI = 130  # text of 7 points stays readable on the page
# Longer lists of numbers are in the CSV files only.
_SHOWN_ROWS = 60
_QUICK = (
    " <b>Quick version:</b> fewer textures and tests, or smaller frames, than without "
    "<code>--quick</code>; one percent may be a single test."
)


_Table = list[list[tuple[str, str]]]


@dataclass(frozen=True)
class PageInfo:
    """Name of a page, the HTML file of its introduction, and the origin of its numbers."""

    page: str
    introduction: Path
    simulated: bool
    quick: bool = False

    @property
    def texts(self) -> dict[str, _Text]:
        """Texts of the exhibits by their keys, from ``notes.toml`` beside the introduction."""
        path = self.introduction.with_name("notes.toml")
        sections = tomllib.loads(path.read_text(encoding="utf-8"))
        return {
            key: _Text(section, **text)
            for section, texts in sections.items()
            for key, text in texts.items()
        }


def _write_exhibit(exhibit: Exhibit, folder: Path) -> bytes | None:
    """Write KEY.csv and, of a figure, KEY.png; return the PNG."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(exhibit.columns)
    writer.writerows(exhibit.rows)
    write_text(folder / f"{exhibit.key}.csv", text.getvalue())
    if exhibit.draw is None:
        return None
    png = _drawn(exhibit.draw, exhibit.size_in)
    with durable_file(folder / f"{exhibit.key}.png") as temporary:
        temporary.write_bytes(png)
    return png


def write_page(
    exhibits: Sequence[Exhibit], facts: Mapping[str, str], info: PageInfo, folder: Path
) -> Path:
    """Write the files of all exhibits, `results.json` and the page; returns the page."""
    drawn = [
        (exhibit, _write_exhibit(exhibit, folder))
        for exhibit in progress(exhibits, len(exhibits), "draw")
    ]
    _write_numbers(exhibits, info, folder / "results.json")
    path = folder / f"{info.page}.html"
    write_text(path, _page(drawn, facts, info))
    return path


def _write_numbers(exhibits: Sequence[Exhibit], info: PageInfo, path: Path) -> None:
    """Write the numbers of all exhibits into one JSON file."""
    texts = info.texts
    contents = {
        "version": version("ps4rig"),
        "simulated": info.simulated,
        "quick": info.quick,
        "exhibits": {
            exhibit.key: {
                "title": texts[exhibit.key].title,
                "columns": exhibit.columns,
                "rows": exhibit.rows,
            }
            for exhibit in exhibits
        },
    }
    write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def _page(
    exhibits: Sequence[tuple[Exhibit, bytes | None]], facts: Mapping[str, str], info: PageInfo
) -> str:
    """HTML of the page from each exhibit and its PNG, in this order."""
    texts = info.texts
    sections: dict[str, list[tuple[Exhibit, _Text, str, _Table]]] = {}
    for exhibit, png in exhibits:
        text = exhibit.text_from(texts)
        entry = exhibit, text, base64.b64encode(png or b"").decode("ascii"), _table(exhibit)
        sections.setdefault(text.section, []).append(entry)
    introduction = Template(info.introduction.read_text(encoding="utf-8"))
    return rendered(
        "chapter/page.html",
        introduction=Markup(introduction.substitute(quick=_QUICK if info.quick else "")),
        facts=facts.items(),
        sections=sections,
    )


def _drawn(draw: Callable[[Figure], None], size_in: tuple[float, float]) -> bytes:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, layout="constrained")
    draw(figure)
    return png_of(figure, _DPI)


def _table(exhibit: Exhibit) -> _Table:
    """The rows as text, header first, each cell with the kind of its column."""
    if exhibit.draw is not None and len(exhibit.rows) > _SHOWN_ROWS:
        return []
    columns = list(zip(*exhibit.rows, strict=True)) or [()] * len(exhibit.columns)
    kinds = []
    for name, cells in zip(exhibit.columns, columns, strict=True):
        is_numeric = all(isinstance(cell, int | float | None) for cell in cells)
        kinds.append("given" if name.startswith("thesis") else "number" if is_numeric else "")
    return [
        [(kind, _as_text(cell, exhibit.digits)) for kind, cell in zip(kinds, row, strict=True)]
        for row in (exhibit.columns, *exhibit.rows)
    ]


def _as_text(cell: Cell, digits: int) -> str:
    """Text of a cell; a dash for None."""
    if cell is None:
        return "-"
    return f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)
