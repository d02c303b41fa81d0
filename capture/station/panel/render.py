"""Pages from the templates of this folder, and answers in JSON."""

import json
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.responses import HTMLResponse, JSONResponse

from capture.base.utc_time import local_time, local_zone

if TYPE_CHECKING:
    from .routes import Call

_HERE = Path(__file__).parent
STATIC = _HERE / "static"


@cache
def _environment() -> Environment:
    made = Environment(
        loader=FileSystemLoader(_HERE / "templates"),
        autoescape=True,  # of every template, whatever its name
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["time"] = local_time
    return made


class JsonAnswer(JSONResponse):
    """JSON in ASCII, which also holds what UTF-8 cannot, and without NaN."""

    def render(self, content: Any) -> bytes:
        """Return the text of the answer."""
        return json.dumps(content, allow_nan=False).encode()


def page(call: "Call", template: str, **values: Any) -> HTMLResponse:
    """Return the page of a template, which gets the names in `about`, and `values`."""
    who = call.who
    menu = [
        route for route in call.request.app.state.menu
        if who is not None and who.role.includes(route.role)
    ]  # fmt: skip
    about = {
        "who": who,
        "menu": menu,
        "station": call.panel.folder.config.name,
        "live": call.panel.live.snapshot(),
        "path": call.request.url.path,
        "zone": local_zone(),
        "version": version("ps4rig"),
    }
    return HTMLResponse(_environment().get_template(template).render(about | values))
