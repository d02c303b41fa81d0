"""Pages of users and API clients, of changes, and of one's own password."""

from fastapi import APIRouter
from starlette.responses import RedirectResponse, Response

from capture.station.domain.roles import Role
from capture.station.results.audit import newest_changes
from capture.station.results.database import ResultsUnavailable
from classify.base.errors import InputError

from .accounts_api import accounts_of
from .guard import ByAdministrator, ByEngineer, ByOperator, Call
from .login import address_of
from .render import page

router = APIRouter(include_in_schema=False)
_SHOWN_CHANGES = 200


@router.get("/accounts")
def _accounts(call: ByAdministrator) -> Response:
    """Users and API clients."""
    return _accounts_page(call)


def _accounts_page(call: Call, message: str = "", token: str = "") -> Response:
    panel = call.panel
    return page(
        call,
        "accounts.html",
        400 if message else 200,
        users=panel.users.all(),
        clients=panel.tokens.all(),
        roles=tuple(Role),
        message=message,
        token=token,
    )


@router.post("/accounts")
def _change_accounts(call: ByAdministrator) -> Response:
    """Add or remove a user or an API client."""
    accounts, action, name = accounts_of(call), call.text("action"), call.text("name")
    try:
        if action == "put user":
            accounts.put_user(name, _role_of(call), call.text("password"))
        elif action == "remove user":
            accounts.remove_user(name)
        elif action == "add client":
            return _accounts_page(call, token=accounts.add_client(name, _role_of(call)))
        elif action == "remove client":
            accounts.remove_client(name)
        else:
            raise InputError(f"action = {action[:20]!r}: no such action")
    except ResultsUnavailable:
        raise
    except InputError as error:
        return _accounts_page(call, message=str(error))
    return RedirectResponse("/accounts", 303)


def _role_of(call: Call) -> Role:
    text = call.text("role")
    if text not in tuple(Role):
        raise InputError(f"role = {text[:20]!r}: give {', '.join(Role)}")
    return Role(text)


@router.get("/changes")
def _changes(call: ByEngineer) -> Response:
    """Who changed what."""
    changes = newest_changes(call.panel.results.store, _SHOWN_CHANGES)
    return page(call, "changes.html", changes=changes, most=_SHOWN_CHANGES)


@router.get("/password")
def _password(call: ByOperator) -> Response:
    """The form for another password."""
    return _password_form(call)


def _password_form(call: Call, message: str = "") -> Response:
    return page(call, "password.html", 400 if message else 200, message=message)


@router.post("/password")
def _change_password(call: ByOperator) -> Response:
    """Replace the password of the user, whose sessions then end."""
    who, panel = call.someone, call.panel
    user = panel.users.get(who.name) if who.via == "page" else None
    if user is None:
        raise InputError("only a user who is logged in has a password")
    address = address_of(call)
    with panel.logins.attempt(user.name, address):
        is_right = panel.users.verified(user.name, call.text("password")) is not None
    if not is_right:
        return _password_form(call, "The present password is wrong.")
    panel.logins.succeeded(user.name, address)
    if call.text("new") != call.text("again"):
        return _password_form(call, "The new passwords differ.")
    try:
        # An administrator may have taken the role, or the account, since it was read.
        accounts_of(call).put_user(user.name, user.role, call.text("new"), user)
    except ResultsUnavailable:
        raise
    except InputError as error:
        return _password_form(call, str(error))
    return RedirectResponse("/login", 303)
