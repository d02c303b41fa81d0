"""One figure or table of the page: its text, its numbers, its drawing."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Cell", "Exhibit", "Row", "Text", "as_text"]

Cell = str | int | float | None
Row = tuple[Cell, ...]


class Text(NamedTuple):
    """Heading of the section, title, and paragraphs on what is shown and what the thesis has."""

    section: str
    title: str
    notes: list[str]


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A figure with its numbers, or a table.

    Attributes
    ----------
    key
        Stem of its files, and of its text in ``notes.toml``.
    columns, rows
        The numbers, as in the CSV file. The name of a column includes its unit.
    draw
        Draws a figure; None for a table.
    size_in
        Width and height of the drawing, inches.
    digits
        Decimals of the numbers of a table.
    values
        Replace the $names in the text.
    """

    key: str
    columns: Sequence[str]
    rows: list[Row]
    draw: Callable[[Figure], None] | None = None
    size_in: tuple[float, float] = (8.0, 4.0)
    digits: int = 1
    values: Mapping[str, object] = field(default_factory=dict)

    @property
    def text(self) -> Text:
        """Text beside it."""
        section, title, notes = _texts()[self.key]
        filled = [" ".join(Template(note).substitute(self.values).split()) for note in notes]
        return Text(section, title, filled)


def as_text(cell: Cell, digits: int) -> str:
    """Text of a cell; a dash for None."""
    if cell is None:
        return "-"
    return f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)


@cache
def _texts() -> dict[str, Text]:
    sections = tomllib.loads(Path(__file__).with_name("notes.toml").read_text(encoding="utf-8"))
    return {
        key: Text(section, **text)
        for section, texts in sections.items()
        for key, text in texts.items()
    }
