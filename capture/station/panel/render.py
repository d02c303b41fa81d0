"""Pages from the templates of this folder, and answers in JSON."""

import json
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.responses import HTMLResponse, JSONResponse

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
    """Return the page of a template, which gets the names in `about`, and `values`."""
    who = call.who
    menu = [each for each in _MENU if who is not None and who.role.includes(each[-1])]
    about = {
        "who": who,
        "status": status,
        "menu": menu,
        "station": call.panel.folder.config.name,
        "live": call.panel.live.snapshot(),
        "path": call.request.url.path,
        "zone": local_zone(),
        "version": version("ps4rig"),
    }
    text = templates(_HERE / "templates").get_template(template).render(about | values)
    return HTMLResponse(text, status)
