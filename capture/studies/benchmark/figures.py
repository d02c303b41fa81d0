"""What a benchmark says: measured numbers, each beside its target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from capture.console import new_table, out, print_table

__all__ = ["Chapter", "Figure", "as_json", "print_chapter"]


@dataclass(frozen=True)
class Figure:
    """One measured number.

    Attributes
    ----------
    step
        What was measured.
    value, unit
        The number, in the first place a ratio.
    ms
        The time behind a ratio.
    target
        What the number is to be, where something was promised.
    bound
        Whether it is to be at most or at least that.
    """

    step: str
    value: float
    unit: str
    ms: float | None = None
    target: float | None = None
    bound: Literal["at most", "at least"] = "at most"

    @property
    def met(self) -> bool | None:
        """Whether the target is met on this machine; None without one."""
        if self.target is None:
            return None
        return self.value <= self.target if self.bound == "at most" else self.value >= self.target


@dataclass(frozen=True)
class Chapter:
    """Figures that belong together, and how they were taken."""

    title: str
    figures: Sequence[Figure]
    notes: Sequence[str] = ()


def as_json(chapter: Chapter) -> dict[str, Any]:
    """A chapter as plain values."""
    return {
        "title": chapter.title,
        "notes": list(chapter.notes),
        "figures": [
            {
                "step": figure.step,
                "value": _rounded(figure.value),
                "unit": figure.unit,
                "ms": None if figure.ms is None else _rounded(figure.ms),
                "target": figure.target,
                "bound": None if figure.target is None else figure.bound,
                "met": figure.met,
            }
            for figure in chapter.figures
        ],
    }


def print_chapter(chapter: Chapter) -> None:
    """A chapter as a table, its notes below."""
    table = new_table("step", "measured", "target", "time", prose="step")
    table.title = chapter.title
    for figure in chapter.figures:
        target = ""
        if figure.target is not None:
            target = f"{figure.bound} {figure.target:g}" + ("" if figure.met else ", missed")
        table.add_row(
            figure.step,
            f"{_shown(figure)} {figure.unit}",
            target,
            "" if figure.ms is None else f"{_short(figure.ms)} ms",
        )
    print_table(table)
    for note in chapter.notes:
        out.print(note)
    out.print()


def _shown(figure: Figure) -> str:
    # Of per cent the last of a hundred matter.
    return f"{figure.value:.2f}" if figure.unit == "%" else _short(figure.value)


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")
