"""Answers: pages from the templates of this folder, JSON, and their description for the API."""

import json
from dataclasses import is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

from fastapi import Response
from jinja2 import Template
from pydantic import BaseModel, Field, create_model
from starlette.responses import HTMLResponse, JSONResponse, StreamingResponse

from capture.base.names import NAME_PATTERN
from capture.base.page import templates
from capture.base.utc_time import local_zone
from capture.station.domain.users import Role
from classify.base.models import Record

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
Name = Annotated[str, Field(pattern=NAME_PATTERN)]


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
    menu = [entry for entry in _MENU if who is not None and who.role.includes(entry[-1])]
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


def answer(model: str, base: type = Record, /, *left_out: str, **fields: Any) -> type[BaseModel]:
    """Return the model of an answer: the fields of `base`, and `fields` by name and type.

    A `base` that is a dataclass gives its fields but those `left_out`. A tuple instead of a type
    has also a default, or a description.
    """
    if is_dataclass(base):
        known = {key: kind for key, kind in get_type_hints(base).items() if key not in left_out}
        base, fields = Record, known | fields
    model_fields: dict[str, Any] = {
        key: kind if isinstance(kind, tuple) else (kind, ...) for key, kind in fields.items()
    }
    return create_model(model, __base__=base, **model_fields)


def media(media_type: str) -> dict[str, Any]:
    """Return the description of a call whose answer is no JSON."""
    schema = {"type": "string"} | ({"format": "binary"} if media_type.startswith("image") else {})
    content = {media_type: {"schema": schema}}
    return {"response_class": Response, "responses": {200: {"content": content}}}


_FAILURE = {
    "description": "not served",
    "model": answer(
        "Failure",
        error=str,
        accepted=(bool, Field(False, description="of a trigger")),
        kind=(str, Field("", description="of a refusal to load a recipe")),
        settings=(dict[str, str], Field({}, description="messages by wrong setting")),
    ),
}
ERRORS: dict[int | str, dict[str, Any]] = {
    401: _FAILURE | {"headers": {"WWW-Authenticate": {"schema": {"type": "string"}}}},
    "4XX": _FAILURE,
    503: _FAILURE | {"headers": {"Retry-After": {"schema": {"type": "integer"}}}},
}
