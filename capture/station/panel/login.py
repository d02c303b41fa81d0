"""Login and logout."""

import math
import re
from contextlib import suppress

from starlette.responses import RedirectResponse, Response

from capture.station.domain.roles import Role
from capture.station.results.database import ResultsUnavailable

from .guard import session_cookie
from .render import page
from .routes import Call, PanelRoute
from .security import Denied

# A path on this station: it begins with one slash; two would begin the name of a host.
_PLACE = re.compile(r"/(?![/\\])[A-Za-z0-9/._-]*")


def _form(call: Call) -> Response:
    return page(call, "login.html", next=_place(call.query.get("next", "/")), message="")


def _login(call: Call) -> Response:
    name, password = call.text("name"), call.text("password")
    client = call.request.client
    address = "" if client is None else client.host
    wait_s = call.panel.logins.begin(name, address)
    if wait_s > 0.0:
        seconds = str(math.ceil(wait_s))
        raise Denied(
            429, f"too many failed logins; try again in {seconds} s", {"Retry-After": seconds}
        )
    user = call.panel.users.verified(name, password)
    place = _place(call.text("next", "/"))
    if user is None:
        further = call.panel.logins.unrecorded()
        if further is not None:
            with suppress(ResultsUnavailable):  # the answer is the same in any case
                call.panel.changes.record_failed_login(name, address, further)
        again = page(call, "login.html", next=place, message="Name or password is wrong.")
        again.status_code = 401
        return again
    call.panel.logins.succeeded(name, address)
    answer = RedirectResponse(place, 303)
    answer.set_cookie(
        session_cookie(call.panel),
        call.panel.sessions.begin(user),
        httponly=True,
        samesite="strict",
        secure=call.panel.settings.is_https,
    )
    return answer


def _logout(call: Call) -> Response:
    cookie = session_cookie(call.panel)
    call.panel.sessions.end(call.request.cookies.get(cookie, ""))
    answer = RedirectResponse("/login", 303)
    answer.delete_cookie(cookie, httponly=True, samesite="strict")
    return answer


def _place(text: str) -> str:
    return text if _PLACE.fullmatch(text) else "/"


ROUTES = (
    PanelRoute("GET", "/login", None, _form, "The login form.", answer="text/html"),
    PanelRoute(
        "POST", "/login", None, _login, "Begin a session.",
        fields={"name": "name of the user", "password": "password", "next": "page after it"},
        answer="text/html",
    ),
    PanelRoute("POST", "/logout", Role.OPERATOR, _logout, "End the session.", answer="text/html"),
)  # fmt: skip
