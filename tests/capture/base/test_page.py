"""The skeleton of pages: one document that refers to nothing, in which all text is escaped."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jinja2 import UndefinedError

from capture.base.page import rendered
from tests.html_page import Page

# A parser of HTML reads line ends alike, and no surrogate or NUL.
ROOM = Path(__file__).parents[3] / "capture"
TEXTS = st.text(st.characters(exclude_categories=["Cc", "Cs"]), min_size=1)


@given(TEXTS, TEXTS)
def test_text_with_markup_and_templates_stays_text(title: str, value: str) -> None:
    html = rendered(
        "station/judge/teaching/teaching.html",
        title=title,
        facts=[("texture", value)],
        is_simulated=True,
        remarks=[value],
        promises=[],
        least_defects=[],
        overlaps=[("overlap", [])],
        limits=[(value, "distance", "1")],
        textures=[(value, [])],
        sets=[],
        tiles=lambda _: [(value, "data:,")],
    )
    page = Page(html)
    assert page.open == []
    assert [tag for tag, _ in page.elements if tag not in ("h2", "div", "p", "b", "small")] == [
        *("html", "head", "meta", "meta", "meta", "title", "style", "body", "h1"),
        *("dl", "dt", "dd", "ul", "li", "figure", "img", "figcaption"),
        *("table", "tr", "th", "th", "th", "tr", "td", "td", "td"),
        *("h3", "figure", "img", "figcaption", "table", "tr"),
        *("th",) * 8,
    ]
    assert page.all("img") == [{"alt": value, "src": "data:,"}] * 2
    for text in (f"{title}: teaching", f"texture{value}", "camera or part is real"):
        assert text in page.text


def test_every_template_of_a_page_can_be_read() -> None:
    templates = [
        path.relative_to(ROOM).as_posix()
        for path in ROOM.rglob("*.html")
        if '{% extends "base/' in path.read_text(encoding="utf-8")
    ]
    assert len(templates) >= 6
    for template in templates:
        # A template that can be read fails only because its values are missing.
        with pytest.raises(UndefinedError):
            rendered(template)
