"""The page of a reproduction: one self-contained HTML file."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template

from .exhibit import Exhibit, as_text

__all__ = ["page"]

_TEMPLATE = Path(__file__).with_name("page.html")
# Longer lists of numbers are in the CSV files only.
_SHOWN_ROWS = 60
_QUICK = (
    " <b>Quick version:</b> fewer textures and orientations, smaller frames than "
    "<code>ps4rig reproduce</code> without <code>--quick</code>; one percent is one or two tests."
)


def page(exhibits: Sequence[tuple[Exhibit, bytes]], facts: Mapping[str, str], quick: bool) -> str:
    """HTML of the page from each exhibit and its PNG, in this order."""
    sections: dict[str, list[str]] = {}
    for exhibit, png in exhibits:
        sections.setdefault(exhibit.section, []).append(_exhibit(exhibit, png))
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(
        quick=_QUICK if quick else "",
        facts="".join(
            f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
            for name, value in facts.items()
        ),
        contents="".join(
            f'<li><a href="#{exhibit.key}">{escape(exhibit.title)}</a></li>'
            for exhibit, _ in exhibits
        ),
        sections="".join(
            f"<h2>{escape(name)}</h2>{''.join(members)}" for name, members in sections.items()
        ),
        version=escape(version("ps4rig")),
    )


def _exhibit(exhibit: Exhibit, png: bytes) -> str:
    notes = "".join(f"<p>{escape(note)}</p>" for note in exhibit.notes)
    files = f'<p class="files">{exhibit.key}.csv, {exhibit.key}.png</p>'
    title, body = escape(exhibit.title), _table(exhibit)
    if exhibit.draw is not None:
        data = base64.b64encode(png).decode("ascii")
        image = f'<img alt="{title}" src="data:image/png;base64,{data}">'
        numbers = f"<details><summary>numbers</summary>{body}</details>" if body else ""
        body = f"<figure>{image}</figure>{numbers}"
    return f'<section id="{exhibit.key}"><h3>{title}</h3>{notes}{body}{files}</section>'


def _table(exhibit: Exhibit) -> str:
    if exhibit.draw is not None and len(exhibit.rows) > _SHOWN_ROWS:
        return ""
    columns = list(zip(*exhibit.rows, strict=True)) or [()] * len(exhibit.columns)
    kinds = []
    for name, cells in zip(exhibit.columns, columns, strict=True):
        numeric = all(isinstance(cell, int | float | None) for cell in cells)
        kind = "given" if name.startswith("thesis") else "number" if numeric else ""
        kinds.append(f' class="{kind}"' if kind else "")
    rows = [
        "".join(
            f"<{tag}{kind}>{escape(as_text(cell, exhibit.digits))}</{tag}>"
            for cell, kind in zip(cells, kinds, strict=True)
        )
        for tag, cells in [("th", exhibit.columns), *(("td", row) for row in exhibit.rows)]
    ]
    return f'<div class="wide"><table><tr>{"</tr><tr>".join(rows)}</tr></table></div>'
