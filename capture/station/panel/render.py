"""Pages from the templates of this folder, and answers in JSON."""

import json
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Template
from starlette.responses import HTMLResponse, JSONResponse, StreamingResponse

from capture.base.page import templates
from capture.base.utc_time import local_zone
from capture.station.domain.roles import Role

if TYPE_CHECKING:
    from .guard import Call

_HERE = Path(__file__).parent
STATIC = _HERE / "static"


# Address, name and lowest role of the pages in the menu.
_MENU = (
    ("/", "Station", Role.OPERATOR),
    ("/history", "History", Role.OPERATOR),
    ("/statistics", "Statistics", Role.OPERATOR),
    ("/recipes", "Recipes", Role.OPERATOR),
    ("/accounts", "Accounts", Role.ADMINISTRATOR),
    ("/changes", "Changes", Role.ENGINEER),
    ("/api", "API", Role.OPERATOR),
)


class JsonAnswer(JSONResponse):
    """JSON in ASCII, which also holds what UTF-8 cannot, and without NaN."""

    def render(self, content: Any) -> bytes:
        """Return the text of the answer."""
        return json.dumps(content, allow_nan=False).encode()


def page(call: "Call", template: str, status: int = 200, **values: Any) -> HTMLResponse:
    """Return the page of a template with some values."""
    page_template, values = _template(call, template, status, values)
    return HTMLResponse(page_template.render(values), status)


def slow_page(call: "Call", template: str, status: int = 200, **values: Any) -> StreamingResponse:
    """Return a page that is sent while a thread still makes the rest of it."""
    page_template, values = _template(call, template, status, values)
    return StreamingResponse(page_template.generate(values), status, media_type="text/html")


def _template(
    call: "Call", template: str, status: int, values: dict[str, Any]
) -> tuple[Template, dict[str, Any]]:
    """Return a template, and its values with those of every page."""
    who = call.who
    menu = [each for each in _MENU if who is not None and who.role.includes(each[-1])]
    common_values = {
        "who": who,
        "status": status,
        "menu": menu,
        "station": call.panel.folder.config.name,
        "live": call.panel.live.snapshot(),
        "path": call.request.url.path,
        "zone": local_zone(),
        "version": version("ps4rig"),
    }
    return templates(_HERE / "templates").get_template(template), common_values | values
