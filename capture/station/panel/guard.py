"""From a row of the table of routes to an endpoint: login, role, and answers to errors."""

import hmac
import inspect
import logging
from collections.abc import Awaitable, Callable, Collection, Sequence
from contextlib import suppress
from typing import cast
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from capture.station.domain.roles import Identity, Role
from capture.station.results.database import ResultsUnavailable
from classify.base.errors import InputError, Ps4rigError

from .panel import Panel
from .render import JsonAnswer, page
from .routes import API, Call, PanelRoute
from .security import SAFE_METHODS, Denied, fields_of, read_body, require_same_origin

_log = logging.getLogger(__name__)
CSRF_FIELD, CSRF_HEADER = "csrf", "x-csrf-token"


def session_cookie(panel: Panel) -> str:
    """Name of the cookie; browsers send cookies to all ports of a machine."""
    return f"ps4rig-{panel.folder.config.name}"


def identity_of(panel: Panel, request: Request) -> Identity | None:
    """Return who asks, or None."""
    kind, _, token = request.headers.get("authorization", "").partition(" ")
    if kind:
        client = panel.tokens.find(token.strip()) if kind.lower() == "bearer" else None
        if client is None:
            raise Denied(401, "the token is not valid", {"WWW-Authenticate": "Bearer"})
        return Identity(client.name, client.role, "API")
    cookie = request.cookies.get(session_cookie(panel))
    if cookie is not None and (identity := panel.sessions.find(cookie)) is not None:
        return identity
    if panel.settings.is_for_this_machine and not panel.users.all():
        return Identity("local", Role.OPERATOR, "this machine")
    return None


def endpoint_of(panel: Panel, route: PanelRoute) -> Callable[[Request], Awaitable[Response]]:
    """Return the function that serves a route."""

    async def endpoint(request: Request) -> Response:
        try:
            return await _answer(panel, route, request)
        except Denied as error:
            return error_answer(panel, request, error.status, str(error), error.headers)
        except ResultsUnavailable as error:
            return error_answer(panel, request, 503, str(error), {"Retry-After": "2"})
        except InputError as error:
            return error_answer(panel, request, 400, str(error))
        except Ps4rigError as error:
            return error_answer(panel, request, 409, str(error))
        except Exception:
            _log.exception("%s %s", route.method, route.path)
            return error_answer(panel, request, 500, "an unforeseen error; see the log")

    return endpoint


async def _answer(panel: Panel, route: PanelRoute, request: Request) -> Response:
    is_change = request.method not in SAFE_METHODS
    if is_change:
        require_same_origin(request)
    who = await run_in_threadpool(identity_of, panel, request)
    if route.role is not None:
        if who is None:
            if route.is_api:
                raise Denied(401, "log in, or send a token", {"WWW-Authenticate": "Bearer"})
            if is_change:
                raise Denied(401, "nothing was changed: the session is over; log in again")
            return RedirectResponse(f"/login?next={quote(request.url.path, safe='')}", 303)
        if not who.role.includes(route.role):
            raise Denied(403, f"{who.name} is {who.role}; this needs the role {route.role}")
    # The body is read after the check of the role: others cannot make this program wait for it.
    fields = fields_of(request, await read_body(request)) if is_change else {}
    if is_change and who is not None and who.csrf and route.role is not None:
        given = request.headers.get(CSRF_HEADER, fields.get(CSRF_FIELD))
        if not isinstance(given, str) or not _same(given, who.csrf):
            raise Denied(403, "the page is out of date; load it again")
    if route.is_api:
        query = [name for name, _ in request.query_params.multi_items()]
        _require_known("query", query, route.query)
        _require_known("field", [name for name in fields if name != CSRF_FIELD], route.fields)
    call = Call(panel, request, who, fields)
    if inspect.iscoroutinefunction(route.handler):
        return await cast(Awaitable[Response], route.handler(call))
    return cast(Response, await run_in_threadpool(route.handler, call))


def _require_known(kind: str, given: Sequence[str], known: Collection[str]) -> None:
    """Refuse what the route does not know: with a misspelled filter, a list has other parts."""
    for name in given:
        if name not in known:
            names = ", ".join(known) or "none"
            raise InputError(f"{kind} {name[:40]!r} is not known; known are: {names}")
        if given.count(name) > 1:
            raise InputError(f"{kind} {name!r} is given more than once")


def _same(given: str, expected: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), expected.encode())


def error_answer(
    panel: Panel, request: Request, status: int, message: str, headers: dict[str, str] | None = None
) -> Response:
    """Return an error: JSON for programs, a page for people."""
    if request.url.path.startswith(API) or request.headers.get("accept") == "application/json":
        return JsonAnswer({"error": message}, status, headers)
    who = None
    with suppress(Denied):
        who = identity_of(panel, request)
    call = Call(panel, request, who)
    answer = page(call, "error.html", status=status, message=message)
    answer.status_code = status
    answer.headers.update(headers or {})
    return answer
