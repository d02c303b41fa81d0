"""Measured numbers with their targets, as a table or as JSON."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, Literal

from capture.base.console import new_table, out, print_table


@dataclass(frozen=True)
class Measurement:
    """One measured number: the name of its step, its value and unit, and its target.

    `ms` is the time that a ratio was computed from.
    """

    step: str
    value: float
    unit: str
    ms: float | None = None
    target: float | None = None
    bound: Literal["at most", "at least"] = "at most"

    @property
    def met(self) -> bool | None:
        """Whether this machine meets the target; None without one."""
        if self.target is None:
            return None
        return self.value <= self.target if self.bound == "at most" else self.value >= self.target


@dataclass(frozen=True)
class Section:
    """Measurements of one subject, and notes on how they were made."""

    title: str
    measurements: Sequence[Measurement]
    notes: Sequence[str] = ()


def as_json(section: Section) -> dict[str, Any]:
    """Dictionary of a section for JSON."""
    figures = [
        asdict(each)
        | {
            "value": _rounded(each.value),
            "ms": None if each.ms is None else _rounded(each.ms),
            "bound": None if each.target is None else each.bound,
            "met": each.met,
        }
        for each in section.measurements
    ]
    return {"title": section.title, "notes": list(section.notes), "figures": figures}


def print_section(section: Section, before: Mapping[str, float] = MappingProxyType({})) -> None:
    """Print a section as a table with its notes below; `before` are earlier values by step."""
    earlier = ["before"] * bool(before)
    table = new_table("step", *earlier, "measured", "target", "time", prose="step")
    table.title = section.title
    for each in section.measurements:
        target = ""
        if each.target is not None:
            target = f"{each.bound} {each.target:g}" + ("" if each.met else ", missed")
        # Near 100 %, hundredths of a percent matter.
        value = f"{each.value:.2f}" if each.unit == "%" else _short(each.value)
        time = "" if each.ms is None else f"{_short(each.ms)} ms"
        cells = [_short(before.get(each.step, math.nan))] * bool(before)
        table.add_row(each.step, *cells, f"{value} {each.unit}", target, time)
    print_table(table)
    for note in section.notes:
        out.print(note)
    out.print()


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")
