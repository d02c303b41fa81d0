"""One figure or table: what it shows, its numbers, how it is drawn."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Cell", "Exhibit", "Row", "as_text", "exhibit"]

Cell = str | int | float | None
Row = tuple[Cell, ...]
Draw = Callable[["Figure"], None]

_NOTES = Path(__file__).with_name("notes.toml")


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A figure of the page with its numbers, or a table.

    Attributes
    ----------
    key
        Stem of its files.
    section
        Heading below which it stands.
    notes
        Paragraphs: what is shown, what the thesis has, where they differ and why.
    columns, rows
        The numbers, as the CSV file holds them. A unit stands in the name of a column.
    draw
        Draws a figure; None for a table.
    size_in
        Width and height of the drawing, inches.
    digits
        Decimals of the numbers of a table.
    """

    key: str
    section: str
    title: str
    notes: tuple[str, ...]
    columns: tuple[str, ...]
    rows: list[Row]
    draw: Draw | None = None
    size_in: tuple[float, float] = (8.0, 4.0)
    digits: int = 1


def exhibit(
    key: str,
    columns: Sequence[str],
    rows: list[Row],
    *,
    draw: Draw | None = None,
    size_in: tuple[float, float] = (8.0, 4.0),
    digits: int = 1,
    **values: object,
) -> Exhibit:
    """An exhibit with its words from ``notes.toml``, in which `values` are put."""
    words = _all_notes()[key]
    return Exhibit(
        key=key,
        section=words["section"],
        title=words["title"],
        notes=tuple(" ".join(Template(note).substitute(values).split()) for note in words["notes"]),
        columns=tuple(columns),
        rows=rows,
        draw=draw,
        size_in=size_in,
        digits=digits,
    )


def as_text(cell: Cell, digits: int) -> str:
    """A cell as people read it; what is not known is a dash."""
    if cell is None:
        return "-"
    return f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)


@lru_cache(maxsize=1)
def _all_notes() -> dict[str, Any]:
    return tomllib.loads(_NOTES.read_text(encoding="utf-8"))
