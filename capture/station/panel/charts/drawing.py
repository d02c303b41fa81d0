"""`Drawing`: a chart as lines, boxes and texts, from which both SVG and PNG are made."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

WIDTH, HEIGHT = 480, 280
# Room for the numbers of the axes, in pixels of the drawing.
LEFT, RIGHT, TOP, BOTTOM = 64, 16, 28, 34
LINE_HEIGHT = 16

Kind = Literal[
    "axis", "grid", "text", "series", "centre", "limit", "base", "alarm", "share",
    "PASS", "FAIL", "UNKNOWN", "ERROR",
]  # fmt: skip
_Anchor = Literal["start", "middle", "end"]


@dataclass(frozen=True)
class Line:
    """Connected points, each ``(x, y)``, y downwards."""

    kind: Kind
    points: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Box:
    """A filled rectangle; a pointer over it shows `about`."""

    kind: Kind
    x: float
    y: float
    width: float
    height: float
    about: str = ""


@dataclass(frozen=True)
class Dot:
    """A filled circle."""

    kind: Kind
    x: float
    y: float
    radius: float
    about: str = ""


@dataclass(frozen=True)
class Words:
    """One line of text; `y` is its base line."""

    x: float
    y: float
    text: str
    anchor: _Anchor = "start"


@dataclass(frozen=True)
class Drawing:
    """A chart of `width` by `height` pixels."""

    about: str  # what it shows, in a sentence, for screen readers
    elements: tuple[Line | Box | Dot | Words, ...]  # later ones cover earlier ones
    width: int = WIDTH
    height: int = HEIGHT


@dataclass(frozen=True)
class Scale:
    """From values to pixels along one axis; `low` lies at `begin`, and `high` at `end`."""

    low: float
    high: float
    begin: float
    end: float

    def __call__(self, value: float) -> float:
        """Return the pixel of a value."""
        share = (value - self.low) / (self.high - self.low)
        return self.begin + share * (self.end - self.begin)


def scale_around(values: Sequence[float], begin: float, end: float) -> Scale:
    """Return a scale on which all values have room."""
    low, high = min(values), max(values)
    room = 0.06 * (high - low) or 0.01 * abs(high) or 1.0
    return Scale(low - room, high + room, begin, end)


def _ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Return equidistant round values from `low` to `high`, at most `most` intervals."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(unit * power for unit in (1, 2, 5, 10) if unit * power >= rough * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [number * step for number in range(first, math.floor(high / step + 1e-9) + 1)]


def _tick_text(value: float, values: Sequence[float]) -> str:
    """Return a value of an axis with the decimals that tell it from the others."""
    step = values[1] - values[0] if len(values) > 1 else abs(value) or 1.0
    return f"{value:.{max(0, -math.floor(math.log10(step) + 1e-9))}f}"


def left_axis(scale: Scale, unit: str = "", most: int = 5) -> Iterator[Line | Words]:
    """Yield lines across the chart and their values, left of it."""
    values = _ticks(scale.low, scale.high, most)
    for value in values:
        y = scale(value)
        yield Line("grid", ((LEFT, y), (WIDTH - RIGHT, y)))
        yield Words(LEFT - 6, y + 4, _tick_text(value, values) + unit, "end")


def bottom_line(height: float = HEIGHT) -> Line:
    """Return the line below the chart."""
    return Line("axis", ((LEFT, height - BOTTOM), (WIDTH - RIGHT, height - BOTTOM)))
