"""Self-contained HTML pages from Jinja2 templates, which extend ``base/skeleton.html``."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Mapping
from functools import cache
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure

_TEMPLATES = Path(__file__).parents[1]


def rendered(template: str, **values: Any) -> str:
    """Return a page from a template below ``capture/``; values are escaped, except `Markup`."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number_text
    environment.filters["percent"] = "{:.1%}".format
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


# HTML in strings, for the pages of sessions and of teaching.


def page_html(
    title: str,
    kind: str,
    sections: Mapping[str, str],
    *,
    facts: Iterable[tuple[str, str]],
    notices: Iterable[str],
    note: str,
) -> str:
    """Return a page of sections, HTML by heading; notices are HTML too."""
    parts = {"sections": sections, "facts": facts, "notices": notices, "note": note}
    return rendered("base/sections.html", title=title, kind=kind, **parts)


def simulated_notice(thing: str) -> str:
    """Return the notice of a page from simulated images of a `thing`."""
    text = f"No light, camera or {escape(thing)} is real."
    return f'<p class="notice"><b>Simulated.</b> {text}</p>'


def table_html(columns: Iterable[str], rows: Iterable[str]) -> str:
    """Return a table with escaped column names; a row is HTML: `<tr>...</tr>`."""
    heads = "".join(f"<th>{escape(column)}</th>" for column in columns)
    return f'<div class="table"><table><tr>{heads}</tr>{"".join(rows)}</table></div>'


def image_html(address: str, name: str, caption: str = "") -> str:
    """Return the image at an address, such as a data URI; name and caption are escaped."""
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<figure><img alt="{escape(name)}" src="{address}">{below}</figure>'


_COLOURS = ("#2166ac", "#b2182b", "#1b7837", "#762a83", "#e08214", "#01665e", "#555555", "#c51b7d")


def curve_colour(number: int) -> str:
    """Return the colour of a curve, numbered from 0; they repeat after eight."""
    return _COLOURS[number % len(_COLOURS)]
