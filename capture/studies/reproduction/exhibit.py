"""One figure or table of the page: its text, its numbers, its drawing."""

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


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A figure with its numbers, or a table.

    Attributes
    ----------
    key
        Stem of its files.
    section
        Heading above it.
    notes
        Paragraphs: what is shown, what the thesis has, where they differ and why.
    columns, rows
        The numbers, as in the CSV file. The name of a column includes its unit.
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
    """Make an exhibit with its text from ``notes.toml``, where `values` replace the $names."""
    text = _all_notes()[key]
    notes = (" ".join(Template(note).substitute(values).split()) for note in text["notes"])
    return Exhibit(
        key, text["section"], text["title"], tuple(notes), tuple(columns), rows, draw, size_in,
        digits,
    )  # fmt: skip


def as_text(cell: Cell, digits: int) -> str:
    """Text of a cell; a dash for None."""
    if cell is None:
        return "-"
    return f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)


@lru_cache(maxsize=1)
def _all_notes() -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_name("notes.toml").read_text(encoding="utf-8"))
