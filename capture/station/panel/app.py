"""`panel_app`: the web application; its routers hold every page and API call."""

import logging
from collections.abc import Iterator
from http import HTTPStatus
from importlib.metadata import version
from typing import Any

from fastapi import APIRouter, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.exceptions import ExceptionMiddleware
from starlette.staticfiles import StaticFiles

from capture.station.domain.errors import Conflict, NotFound
from capture.station.panel import (
    accounts,
    api,
    event_stream,
    login,
    pictures_api,
    result_pages,
    statistics_api,
)
from capture.station.panel.recipes import recipe_pages, recipes_api
from capture.station.results.database import ResultsUnavailable
from classify.base.errors import InputError, Ps4rigError
from classify.base.models import in_words

from .answers import ERRORS, STATIC, JsonAnswer, page
from .guard import V1, ByOperator, Call, identity_of, without_login
from .panel import Panel
from .security import STATIC_PATH, BodyLimit, Denied, SecureHeaders

_log = logging.getLogger(__name__)
_description = APIRouter()
_ROUTERS: tuple[APIRouter, ...] = (
    login.router,
    result_pages.router,
    recipe_pages.router,
    api.router,
    pictures_api.router,
    statistics_api.router,
    recipes_api.router,
    event_stream.router,
    accounts.router,
    accounts.pages,
    _description,
)


def routes() -> Iterator[APIRoute]:
    """Yield every page and API call; tests try each with every role."""
    for router in _ROUTERS:
        yield from (route for route in router.routes if isinstance(route, APIRoute))


def _application(*middleware: Middleware) -> FastAPI:
    app = FastAPI(
        title="ps4rig station",
        version=version("ps4rig"),
        # FastAPI's own pages would load scripts from other servers.
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        default_response_class=JsonAnswer,
        responses=ERRORS,
        separate_input_output_schemas=False,
        generate_unique_id_function=lambda route: route.name.lstrip("_"),
        middleware=middleware,
        exception_handlers=dict.fromkeys(
            (HTTPException, RequestValidationError, Ps4rigError), _refused
        ),
    )
    for router in _ROUTERS:
        app.include_router(router)
    return app


def panel_app(panel: Panel) -> FastAPI:
    """Return the web application of a station."""
    settings = panel.settings
    app = _application(
        Middleware(SecureHeaders, names=settings.names, is_https=settings.is_https),
        Middleware(ExceptionMiddleware, handlers={Exception: _refused}),
        Middleware(BodyLimit),
    )
    app.state.panel, app.state.description = panel, DESCRIPTION
    app.mount(STATIC_PATH, StaticFiles(directory=STATIC))
    return app


async def _refused(request: Request, error: Exception) -> Response:
    """Answer an error: with JSON for programs, with a page for people."""
    panel, who, denied = request.app.state.panel, None, without_login(request)
    try:
        who = await run_in_threadpool(identity_of, panel, request)
    except Denied as other:
        denied = other
    except Ps4rigError:
        pass
    if who is None and isinstance(error, RequestValidationError):
        error = denied  # FastAPI validates a request before the login is checked
    status, message, headers = _status_of(request, error)
    if request.url.path.startswith(V1) or request.headers.get("accept") == "application/json":
        return JsonAnswer({"error": message}, status, headers)
    answer = page(Call(panel, request, who), "error.html", status, message=message)
    answer.headers.update(headers)
    return answer


def _status_of(request: Request, error: Exception) -> tuple[int, str, dict[str, str]]:
    match error:
        case HTTPException(status_code=HTTPStatus.METHOD_NOT_ALLOWED):
            path = request.url.path
            matches = (route for route in routes() if route.path_regex.match(path))
            methods = {name for route in matches for name in route.methods or ()}
            allowed = ", ".join(sorted(methods))
            return 405, f"{request.method} is not allowed here", {"Allow": allowed}
        case HTTPException():
            detail = "there is no such page" if error.detail == "Not Found" else error.detail
            return error.status_code, detail, dict(error.headers or {})
        case RequestValidationError():
            faults = error.errors()
            status = 404 if any(fault["loc"][0] == "path" for fault in faults) else 400
            return status, "; ".join(map(_fault, faults)), {}
        case ResultsUnavailable():
            return 503, str(error), {"Retry-After": "2"}
        case NotFound():
            return 404, str(error), {}
        case InputError() if not isinstance(error, Conflict):
            return 400, str(error), {}
        case Ps4rigError():
            return 409, str(error), {}
    _log.error("%s %s", request.method, request.url.path, exc_info=error)
    return 500, "an unforeseen error; see the log", {}


def _fault(fault: Any) -> str:
    place, *names = map(str, fault["loc"])
    match fault["type"]:
        case "json_invalid":
            return f"the body is not JSON: {fault['ctx']['error']}"
        case "extra_forbidden":
            return f"{'.'.join(names)}: this call has no such field; /api lists them"
    return f"{'.'.join(names) or place}: {in_words(fault['msg'])}"


@_description.get(f"{V1}/openapi.json")
def _openapi(call: ByOperator) -> dict[str, Any]:
    """Describe all calls, as OpenAPI 3.1."""
    document: dict[str, Any] = call.request.app.state.description
    return document


@_description.get("/api", include_in_schema=False)
def _api_page(call: ByOperator) -> Response:
    """The description of the API."""
    return page(call, "api.html", **DESCRIPTION)


DESCRIPTION = _application().openapi()
"""All calls as OpenAPI. Made at import, before panels are forked, because it takes 0.2 s."""
