"""`Call`: a request that may be served; its dependency checks origin, login, role and token."""

import hmac
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated
from urllib.parse import quote

from fastapi import Depends, Request, Security
from fastapi.security import HTTPBearer, SecurityScopes
from starlette.concurrency import run_in_threadpool

from capture.station.domain.users import Identity, Role
from classify.base.errors import InputError

from .panel import Panel
from .security import Denied, form_of, require_same_origin

V1 = "/api/v1"
CSRF_FIELD, _CSRF_HEADER = "csrf", "x-csrf-token"
_TOKEN = HTTPBearer(
    scheme_name="token", description="Token of an API client.", auto_error=False
)  # describes it; `identity_of` reads it


@dataclass(frozen=True)
class Call:
    """A request that may be served."""

    panel: Panel
    request: Request
    who: Identity | None  # None where no login is needed
    fields: Mapping[str, str] = field(default_factory=dict)  # of the form of a page

    @property
    def someone(self) -> Identity:
        """The user or client, on a route that needs a role."""
        assert self.who is not None
        return self.who

    @property
    def name(self) -> str:
        """Name of the user or client, for records."""
        return self.someone.name

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text of the form."""
        value = self.fields.get(name, default)
        if value is None:
            raise InputError(f"{name}: missing")
        return value


def session_cookie(panel: Panel) -> str:
    """Name of the cookie; browsers send cookies to all ports of a machine."""
    return f"ps4rig-{panel.folder.config.name}"


def identity_of(panel: Panel, request: Request) -> Identity | None:
    """Return the user or client of a request, or None without a login."""
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


async def _call(
    request: Request, needed: SecurityScopes, _: Annotated[object, Depends(_TOKEN)]
) -> Call:
    """Return a request if the user or client has the role that its route needs."""
    panel: Panel = request.app.state.panel
    is_api = request.url.path.startswith(V1)
    is_change = request.method != "GET"
    if is_change:
        require_same_origin(request)
    who = await run_in_threadpool(identity_of, panel, request)
    for role in needed.scopes:
        if who is None:
            raise without_login(request)
        if not who.role.includes(Role(role)):
            raise Denied(403, f"{who.name} is {who.role}; this needs the role {role}")
    fields = form_of(request, await request.body()) if is_change and not is_api else {}
    if is_change and needed.scopes and who is not None and who.csrf:
        sent_token = request.headers.get(_CSRF_HEADER, fields.get(CSRF_FIELD, ""))
        if not hmac.compare_digest(sent_token.encode("utf-8", "replace"), who.csrf.encode()):
            raise Denied(403, "the page is out of date; load it again")
    if is_api:
        _require_known(request, await request.body() if is_change else b"")
    return Call(panel, request, who, fields)


def without_login(request: Request) -> Denied:
    """Return the answer to a request without a login: a page leads people to the login."""
    if request.url.path.startswith(V1):
        return Denied(401, "log in, or send a token", {"WWW-Authenticate": "Bearer"})
    if request.method != "GET":
        return Denied(401, "nothing was changed: the session is over; log in again")
    path = quote(request.url.path, safe="")
    return Denied(303, "log in", {"Location": f"/login?next={path}"})


def _require_known(request: Request, body: bytes) -> None:
    """Refuse parameters and bodies that the API does not have, such as a misspelled filter."""
    paths = request.app.state.description["paths"]
    operation = paths[request.scope["route"].path][request.method.lower()]
    parameters = operation.get("parameters", [])
    known = [parameter["name"] for parameter in parameters if parameter["in"] == "query"]
    sent_names = [name for name, _ in request.query_params.multi_items()]
    for name in sent_names:
        if name not in known:
            names = ", ".join(known) or "none"
            raise InputError(f"query {name[:40]!r} is not known; known are: {names}")
        if sent_names.count(name) > 1:
            raise InputError(f"query {name!r} is given more than once")
    if body and not request.headers.get("content-type", "").lower().startswith("application/json"):
        raise Denied(415, "the body must be application/json")
    if "requestBody" not in operation and body and json.loads(body) != {}:
        raise InputError("the body must be empty: this call has no fields")


ByAnybody = Annotated[Call, Depends(_call)]
ByOperator = Annotated[Call, Security(_call, scopes=[Role.OPERATOR])]
ByEngineer = Annotated[Call, Security(_call, scopes=[Role.ENGINEER])]
ByAdministrator = Annotated[Call, Security(_call, scopes=[Role.ADMINISTRATOR])]


def _turn(call: ByOperator) -> Iterator[None]:
    """Refuse a request that may read all parts while others do."""
    with call.panel.reckoning.slot():
        yield


Turn = Annotated[None, Depends(_turn)]
