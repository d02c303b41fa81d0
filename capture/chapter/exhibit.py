"""One figure or table of the page: its text, its numbers, its drawing."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell = str | int | float | None
Row = tuple[Cell, ...]


class Text(NamedTuple):
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

    def text_from(self, texts: Mapping[str, Text]) -> Text:
        """Text beside the exhibit, with its values."""
        section, title, notes = texts[self.key]
        filled = [" ".join(Template(note).substitute(self.values).split()) for note in notes]
        return Text(section, title, filled)


def read_texts(path: Path) -> dict[str, Text]:
    """Read the texts of exhibits, by their keys, from a ``notes.toml``."""
    sections = tomllib.loads(path.read_text(encoding="utf-8"))
    return {
        key: Text(section, **text)
        for section, texts in sections.items()
        for key, text in texts.items()
    }
