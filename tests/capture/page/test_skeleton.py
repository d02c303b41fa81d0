"""The skeleton of pages: one document that refers to nothing, in which all text is escaped."""

from hypothesis import given
from hypothesis import strategies as st

from capture.page.skeleton import image_html, page_html, simulated_notice, table_html
from tests.html_page import Page

# A parser of HTML reads line ends alike, and no surrogate or NUL.
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
    for shown in (f"{title}: test", f"{name}{value}", f"camera or {value} is real", f"{value} ps4rig "):
        assert shown in page.text
