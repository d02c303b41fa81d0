"""The skeleton of pages: one document that refers to nothing, in which all text is escaped."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jinja2 import UndefinedError

from capture.base.page import image_html, page_html, rendered, simulated_notice, table_html
from tests.html_page import Page

# A parser of HTML reads line ends alike, and no surrogate or NUL.
ROOM = Path(__file__).parents[3] / "capture"
TEXTS = st.text(st.characters(exclude_categories=["Cc", "Cs"]), min_size=1)


@given(TEXTS, TEXTS, TEXTS)
def test_text_with_markup_and_templates_stays_text(title: str, name: str, value: str) -> None:
    html = page_html(
        title,
        "test",
        {name: table_html([value], []) + image_html("data:,", name, value), "none": ""},
        facts=[(name, value)],
        notices=[simulated_notice(value)],
        note=value,
    )
    page = Page(html)
    assert page.open == []
    assert [tag for tag, _ in page.elements] == [
        "html",
        "head",
        "meta",
        "meta",
        "meta",
        "title",
        "style",
        "body",
        "h1",
        "p",
        "b",
        "dl",
        "div",
        "dt",
        "dd",
        "h2",
        "div",
        "table",
        "tr",
        "th",
        "figure",
        "img",
        "figcaption",
        "p",
        "small",
    ]
    assert page.all("img") == [{"alt": name, "src": "data:,"}]
    for shown in (
        f"{title}: test",
        f"{name}{value}",
        f"camera or {value} is real",
        f"{value} ps4rig ",
    ):
        assert shown in page.text


def test_every_template_of_a_page_can_be_read() -> None:
    templates = [
        path.relative_to(ROOM).as_posix()
        for path in ROOM.rglob("*.html")
        if '{% extends "base/' in path.read_text(encoding="utf-8")
    ]
    assert len(templates) >= 6
    for template in templates:
        # Without values a template that can be read lacks one.
        with pytest.raises(UndefinedError):
            rendered(template)
