"""HTML pages from Jinja2 templates; self-contained ones extend ``base/skeleton.html``."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .utc_time import local_time

if TYPE_CHECKING:
    from jinja2 import Environment

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
