"""The description of the API, from the table of routes: as OpenAPI, and as a page."""

import re
from collections.abc import Iterable
from importlib.metadata import version
from typing import Any

from starlette.responses import Response

from capture.station.domain.roles import Role

from .api import V1
from .render import JsonAnswer, page
from .routes import Call, PanelRoute

_TEXT = {"type": "string"}


def document(routes: Iterable[PanelRoute]) -> dict[str, Any]:
    """Return the description of all API calls among `routes` as OpenAPI 3.1."""
    paths: dict[str, dict[str, Any]] = {}
    for route in routes:
        if route.is_api:
            paths.setdefault(route.path, {})[route.method.lower()] = _operation(route)
    return {
        "openapi": "3.1.0",
        "info": {"title": "ps4rig station", "version": version("ps4rig")},
        "paths": paths,
        "components": {
            "securitySchemes": {
                "token": {"type": "http", "scheme": "bearer"},
            }
        },
        "security": [{"token": []}],
    }


def _operation(route: PanelRoute) -> dict[str, Any]:
    parameters = [
        {"name": name, "in": "path", "required": True, "schema": _TEXT}
        for name in re.findall(r"{(\w+)}", route.path)
    ] + [
        {"name": name, "in": "query", "description": meaning, "schema": _TEXT}
        for name, meaning in route.query.items()
    ]
    operation: dict[str, Any] = {
        "summary": route.about,
        "description": f"Needs the role {route.role}.",
        "parameters": parameters,
        "responses": {
            "2XX": {"description": "done", "content": {route.answer: {}}},
            "4XX": {"description": "not served; `error` says why", "content": {"application/json": {
                "schema": {"type": "object", "properties": {"error": _TEXT}}
            }}},
        },
    }  # fmt: skip
    if route.fields:
        properties = {
            name: {"type": route.types.get(name, "string"), "description": meaning}
            for name, meaning in route.fields.items()
        }
        schema = {"type": "object", "properties": properties}
        operation["requestBody"] = {"content": {"application/json": {"schema": schema}}}
    return operation


def _document(call: Call) -> Response:
    return JsonAnswer(document(call.request.app.state.routes))


def _page(call: Call) -> Response:
    routes = [route for route in call.request.app.state.routes if route.is_api]
    return page(call, "api.html", routes=routes)


ROUTES = (
    PanelRoute(
        "GET", f"{V1}/openapi.json", Role.OPERATOR, _document, "This description, as OpenAPI 3.1."
    ),
    PanelRoute(
        "GET", "/api", Role.OPERATOR, _page, "The description of the API.", answer="text/html",
        menu="API",
    ),
)  # fmt: skip
