"""Login and logout."""

import re
from contextlib import suppress

from fastapi import APIRouter
from starlette.responses import RedirectResponse, Response

from capture.station.domain.users import KIOSK
from capture.station.results.database import ResultsUnavailable

from .answers import page
from .guard import ByAnybody, ByOperator, Call, session_cookie

router = APIRouter(include_in_schema=False)
# A path on this station: it begins with one slash; two would begin the name of a host.
_LOCAL_PATH = re.compile(r"/(?![/\\])[A-Za-z0-9/._-]*")


@router.get("/login")
def _form(call: ByAnybody, next: str = "/") -> Response:  # noqa: A002 - a name of the query
    """The login form."""
    return _page(call, _local_path(next))


def _page(call: Call, next_path: str, message: str = "") -> Response:
    return page(
        call,
        "login.html",
        401 if message else 200,
        next=next_path,
        kiosk=_is_screen(call) and call.panel.users.get(KIOSK) is not None,
        message=message,
    )


@router.post("/login")
def _login(call: ByAnybody) -> Response:
    """Begin a session."""
    pin, address = call.text("pin", ""), address_of(call)
    name, password = (KIOSK, pin) if pin else (call.text("name"), call.text("password"))
    is_allowed = _is_screen(call) if pin else name != KIOSK
    with call.panel.logins.attempt(name, address):
        user = call.panel.users.verified(name if is_allowed else "", password)
    next_path = _local_path(call.text("next", "/"))
    if user is None:
        unrecorded = call.panel.logins.unrecorded()
        if unrecorded is not None:
            via = "kiosk" if pin else "page"
            with suppress(ResultsUnavailable):  # the answer is the same in any case
                call.panel.results.record_failed_login(name, address, via, unrecorded)
        message = "The PIN is wrong." if pin else "Name or password is wrong."
        return _page(call, next_path, message)
    call.panel.logins.succeeded(name, address)
    answer = RedirectResponse(next_path, 303)
    answer.set_cookie(
        session_cookie(call.panel),
        call.panel.sessions.begin(user),
        httponly=True,
        samesite="strict",
        secure=call.panel.settings.is_https,
    )
    return answer


@router.post("/logout")
def _logout(call: ByOperator) -> Response:
    """End the session."""
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


def _local_path(text: str) -> str:
    return text if _LOCAL_PATH.fullmatch(text) else "/"
