"""HTML pages from Jinja2 templates; self-contained ones extend ``base/skeleton.html``."""

from __future__ import annotations

import base64
import io
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .utc_time import local_time

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure

_TEMPLATES = Path(__file__).parents[1]


def rendered(template: str, **values: Any) -> str:
    """Return a page from a template below ``capture/``; values are escaped, except `Markup`."""
    return templates().get_template(template).render(values)


@cache
def templates(folder: Path = _TEMPLATES) -> Environment:
    """Return the templates of a folder."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,  # of every template, whatever its name
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number_text
    environment.filters["percent"] = "{:.1%}".format
    environment.filters["time"] = local_time
    environment.globals["version"] = version("ps4rig")
    return environment


def number_text(value: float) -> str:
    """Return three digits of a number, with a minus sign."""
    return f"{value:.3g}".replace("-", "\N{MINUS SIGN}")


def svg_uri(figure: Figure) -> str:
    """Return the address of a figure as an SVG image, whose names cannot collide with others."""
    text = io.BytesIO()
    # A date would make two equal pages differ.
    figure.savefig(text, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(text.getvalue()).decode("ascii")


_COLOURS = ("#2166ac", "#b2182b", "#1b7837", "#762a83", "#e08214", "#01665e", "#555555", "#c51b7d")


def curve_colour(number: int) -> str:
    """Return the colour of a curve, numbered from 0; they repeat after eight."""
    return _COLOURS[number % len(_COLOURS)]
