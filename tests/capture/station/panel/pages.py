"""All pages of the panel, from the table of routes, and how a test opens them."""

import re

from capture.station.domain.recipe_file import read_recipe
from capture.station.domain.users import Role
from tests.capture.station.panel.demonstration import failed
from tests.capture.station.panel.panels import PASSWORD, ServedPanel
from tests.capture.station.panel.routes import ROUTES, PanelRoute
from tests.chromium import Chromium, Page

_SHOWN = [route for route in ROUTES if route.is_page]
# The report of teaching is for paper too: it is white in a dark room, and has no menu.
_REPORTS = {"/recipes/{name}/versions/{version}/teaching"}
PAGES = [route for route in _SHOWN if route.path not in _REPORTS]
REPORTS = [route for route in _SHOWN if route.path in _REPORTS]


def address_of(route: PanelRoute, station: ServedPanel) -> str:
    """The address of a page, with the worst part and the recipe of the station."""
    recipe = read_recipe(station.panel.folder.recipe_files().file)
    places = {"part_id": failed(station)[0], "name": recipe.name, "version": recipe.version}
    missing = set(re.findall(r"{(\w+)}", route.path)) - set(places)
    assert not missing, f"{route.path}: say here what stands for {missing}"
    return station.url.rstrip("/") + route.path.format(**places)


def logged_in(browser: Chromium, station: ServedPanel, name: str = Role.ADMINISTRATOR) -> Page:
    """A page of a user, who logged in with the keyboard."""
    page = browser.page(f"{station.url}login")
    page.type(name)
    page.press("Tab")
    page.type(PASSWORD)
    page.press("Enter")
    page.until_at("/")
    return page
