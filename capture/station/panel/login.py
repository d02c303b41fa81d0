"""Login and logout."""

import re
from contextlib import suppress

from starlette.responses import RedirectResponse, Response

from capture.station.domain.roles import Role
from capture.station.domain.users import KIOSK
from capture.station.results.database import ResultsUnavailable

from .guard import session_cookie
from .render import page
from .routes import Call, PanelRoute

# A path on this station: it begins with one slash; two would begin the name of a host.
_PLACE = re.compile(r"/(?![/\\])[A-Za-z0-9/._-]*")


def _form(call: Call, place: str = "", message: str = "") -> Response:
    answer = page(
        call,
        "login.html",
        next=place or _place(call.query.get("next", "/")),
        kiosk=_is_screen(call) and call.panel.users.get(KIOSK) is not None,
        message=message,
    )
    answer.status_code = 401 if message else 200
    return answer


def _login(call: Call) -> Response:
    pin, address = call.text("pin", ""), address_of(call)
    name, password = (KIOSK, pin) if pin else (call.text("name"), call.text("password"))
    is_allowed = _is_screen(call) if pin else name != KIOSK
    with call.panel.logins.attempt(name, address):
        user = call.panel.users.verified(name if is_allowed else "", password)
    place = _place(call.text("next", "/"))
    if user is None:
        further = call.panel.logins.unrecorded()
        if further is not None:
            via = "kiosk" if pin else "page"
            with suppress(ResultsUnavailable):  # the answer is the same in any case
                call.panel.changes.record_failed_login(name, address, via, further)
        return _form(call, place, "The PIN is wrong." if pin else "Name or password is wrong.")
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


def address_of(call: Call) -> str:
    """Return the IP address of the client."""
    client = call.request.client
    return "" if client is None else client.host.removeprefix("::ffff:")


def _is_screen(call: Call) -> bool:
    return address_of(call) in map(str, call.panel.settings.kiosk_addresses)


def _place(text: str) -> str:
    return text if _PLACE.fullmatch(text) else "/"


ROUTES = (
    PanelRoute("GET", "/login", None, _form, "The login form.", answer="text/html"),
    PanelRoute(
        "POST", "/login", None, _login, "Begin a session.",
        fields={
            "name": "name of the user", "password": "password", "next": "page after it",
            "pin": "PIN of a screen of the line, instead of name and password",
        },
        answer="text/html",
    ),
    PanelRoute("POST", "/logout", Role.OPERATOR, _logout, "End the session.", answer="text/html"),
)  # fmt: skip
