"""Every page of the panel in Chromium, by the table of routes: axe-core, keyboard, screens."""

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from capture.station.domain.users import Role
from tests.accessibility import grave_findings, missed_by_tab
from tests.capture.station.panel.demonstration import demonstration, failed
from tests.capture.station.panel.pages import PAGES, REPORTS, address_of, logged_in
from tests.capture.station.panel.panels import ServedPanel
from tests.capture.station.panel.routes import PanelRoute
from tests.chromium import Chromium, Page, chromium

SCREENS = {
    "screen, light": (1280, 800, False), "tablet, dark": (1024, 768, True),
    "telephone, light": (390, 844, False),
}  # fmt: skip
# Elements that reach beyond the screen and are in no box that scrolls.
CUT = """
[...document.querySelectorAll('main *')]
  .filter((each) => each.checkVisibility() && each.getBoundingClientRect().right > innerWidth + 1
    && !each.closest('.table, .hidden'))
  .map((each) => each.outerHTML.slice(0, 100))
"""
# The sizes of the letters of all charts, as they are on the screen.
LETTERS_PX = """
[...document.querySelectorAll('.drawing text')].map(
  (each) => parseFloat(getComputedStyle(each).fontSize) * each.getScreenCTM().a)
"""
# The smallest text of a page.
SMALLEST_PX = """
Math.min(...[...document.querySelectorAll('main *')]
  .filter((each) => each.checkVisibility() && [...each.childNodes].some(
    (node) => node.nodeType == Node.TEXT_NODE && node.textContent.trim()))
  .map((each) => parseFloat(getComputedStyle(each).fontSize)))
"""
pytestmark = [pytest.mark.browser]


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedPanel]:
    with demonstration(tmp_path_factory.mktemp("pages") / "line-1") as served:
        yield served


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with chromium(tmp_path_factory.mktemp("profile")) as running:
        yield running


@pytest.fixture(scope="module")
def administrator(station: ServedPanel, browser: Chromium) -> Page:
    """A page of an administrator, who may open all."""
    return logged_in(browser, station)


def test_the_checks_find_faults_that_a_page_has(administrator: Page, station: ServedPanel) -> None:
    administrator.go(f"{station.url}history")
    administrator.value(
        "document.querySelector('main').innerHTML = '<h1>x</h1><img src=/static/icon.svg>"
        "<a href=/>seen</a><button class=no-ring>pressed</button>'; "
        "document.querySelector('.no-ring').addEventListener('focus', ({target}) => target.blur());"
        "1"
    )
    (finding,) = grave_findings(administrator)
    assert finding.startswith("image-alt")
    assert "no-ring" in " ".join(missed_by_tab(administrator))


@pytest.mark.parametrize("route", PAGES, ids=lambda route: route.path)
def test_a_page_is_for_everybody_on_screens_and_tablets_in_a_light_and_a_dark_room(
    station: ServedPanel, administrator: Page, route: PanelRoute
) -> None:
    page, address = administrator, address_of(route, station)
    for width, height, dark in SCREENS.values():
        page.show(width, height, dark=dark)
        page.go(address)
        assert page.value("document.documentElement.scrollWidth") <= width
        assert page.value(CUT) == []
        assert min(page.value(LETTERS_PX), default=10.0) >= 10.0
        assert page.value("document.documentElement.scrollHeight") < 6000
        back = page.value("getComputedStyle(document.body).backgroundColor")
        assert (sum(map(int, back[4:-1].split(","))) < 380) is dark
        assert page.value("document.querySelectorAll('h1').length") == 1
        assert grave_findings(page) == []
    assert missed_by_tab(page) == []
    assert page.errors() == []


def test_a_part_is_short_and_legible_on_a_telephone(
    station: ServedPanel, administrator: Page
) -> None:
    page = administrator
    page.show(390, 844)
    page.go(f"{station.url}parts/{failed(station)[0]}")
    page.until("document.querySelectorAll('#views button').length > 3")
    assert page.value("document.documentElement.scrollHeight") < 3000
    assert page.value(SMALLEST_PX) >= 12.0
    # Four views side by side, and what is seldom read closed until somebody asks for it.
    tops = "[...document.querySelectorAll('#views button')].map((each) => each.offsetTop)"
    assert len(set(page.value(tops)[:4])) == 1
    assert page.value("[...document.querySelectorAll('.fold')].map((each) => each.open)") == [
        False,
        False,
    ]
    page.show(1280, 800)
    page.go(f"{station.url}parts/{failed(station)[0]}")
    assert page.value("document.querySelectorAll('.fold[open]').length") == 2


@pytest.mark.parametrize("route", REPORTS, ids=lambda route: route.path)
def test_a_report_is_for_everybody(
    station: ServedPanel, administrator: Page, route: PanelRoute, tmp_path: Path
) -> None:
    """Opened as a file: the panel serves reports in a sandbox, in which axe-core cannot run."""
    path = urlsplit(address_of(route, station)).path
    answer = station.client(Role.OPERATOR).get(path)
    assert answer.status == 200
    (tmp_path / "report.html").write_bytes(answer.body)
    administrator.go((tmp_path / "report.html").as_uri())
    assert grave_findings(administrator) == []
    assert missed_by_tab(administrator) == []
    assert administrator.errors() == []


def test_an_engineer_finds_a_part_and_opens_it_by_the_keyboard_alone(
    station: ServedPanel, administrator: Page
) -> None:
    part_id, page = failed(station)[-1], administrator

    page.go(station.url)
    page.tab_to('nav a[href="/history"]')
    page.press("Enter")
    page.until_at("/history")
    page.tab_to('input[name="part"]')
    page.type(part_id)
    page.press("Enter")
    rows = "document.querySelectorAll('.parts tbody tr').length"
    page.until(f"document.readyState == 'complete' && {rows} == 1")
    page.tab_to(f'a[href="/parts/{part_id}"]')
    page.press("Enter")
    page.until_at(f"/parts/{part_id}")
    assert part_id in page.value("document.querySelector('h1').textContent")
    assert page.errors() == []
