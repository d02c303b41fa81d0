"""Pages from parts: title, notices, facts, sections with figures and tables, a foot note."""

from collections.abc import Iterable, Mapping
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template

_SKELETON = Path(__file__).with_name("skeleton.html")


def page_html(
    title: str,
    kind: str,
    sections: Mapping[str, str],
    *,
    facts: Iterable[tuple[str, str]] = (),
    notices: Iterable[str] = (),
    note: str = "",
    style: str = "",
) -> str:
    """Return a self-contained page."""
    foot = f"{escape(note)} ps4rig {escape(version('ps4rig'))}."
    body = (
        f"<h1>{escape(title)}</h1>",
        "".join(notices),
        facts_html(facts),
        sections_html(sections),
        f"<p><small>{foot}</small></p>",
    )
    return document_html(f"{title}: {kind}", "\n".join(body), style)


def document_html(title: str, body: str, style: str = "") -> str:
    """Return a document that loads nothing from elsewhere; `body` is HTML, `style` is CSS."""
    skeleton = Template(_SKELETON.read_text(encoding="utf-8"))
    return skeleton.substitute(title=escape(title), style=style, body=body)


def facts_html(facts: Iterable[tuple[str, str]]) -> str:
    """Return names and values side by side; they are escaped."""
    each = (f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    return f"<dl>{''.join(each)}</dl>"


def sections_html(sections: Mapping[str, str]) -> str:
    """Return sections of HTML below their headings, which are escaped; empty ones are left out."""
    return "".join(
        f"<h2>{escape(name)}</h2>{content}" for name, content in sections.items() if content
    )


def notice(text: str, strong: str = "") -> str:
    """Return a notice in a box, after some words in bold; both are escaped."""
    bold = f"<b>{escape(strong)}</b> " if strong else ""
    return f'<p class="notice">{bold}{escape(text)}</p>'


def simulated_notice(thing: str) -> str:
    """Return the notice of a page from simulated images of a `thing`."""
    return notice(f"No light, camera or {thing} is real.", "Simulated.")


def table_html(columns: Iterable[str], rows: Iterable[str]) -> str:
    """Return a table with escaped column names; a row is HTML: `<tr>...</tr>`."""
    heads = "".join(f"<th>{escape(column)}</th>" for column in columns)
    return f'<div class="table"><table><tr>{heads}</tr>{"".join(rows)}</table></div>'


def image_html(address: str, name: str, caption: str = "") -> str:
    """Return the image at an address, such as a data URI; name and caption are escaped."""
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<figure><img alt="{escape(name)}" src="{address}">{below}</figure>'
