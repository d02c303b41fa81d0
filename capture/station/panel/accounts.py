"""Users and API clients, changes, and one's own password: calls and pages."""

from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field, conlist
from starlette.responses import RedirectResponse, Response

from capture.station.domain.users import MAX_PASSWORD_LENGTH, MIN_PASSWORD_LENGTH, Role
from capture.station.results.accounts import Accounts
from capture.station.results.audit import newest_changes
from classify.base.errors import InputError
from classify.base.models import Record

from .answers import Name, answer, page
from .guard import V1, ByAdministrator, ByEngineer, ByOperator, Call
from .login import address_of

router = APIRouter(prefix=V1)
pages = APIRouter(include_in_schema=False)
_SHOWN_CHANGES = 200  # the newest
_Account = answer("Account", name=str, role=Role)
_Users = answer("Users", users=conlist(_Account))
_Client = answer("Client", _Account, created_utc=str)
_Clients = answer("Clients", clients=conlist(_Client))
_NewClient = answer("NewClient", _Account, token=str)
_Removed = answer("Removed", name=str, removed=bool)


class AccountFields(Record):
    """An API client to add."""

    name: Name
    role: Role


class UserFields(AccountFields):
    """A user to add or change."""

    password: Annotated[str, Field(min_length=MIN_PASSWORD_LENGTH, max_length=MAX_PASSWORD_LENGTH)]


def _accounts_of(call: Call) -> Accounts:
    """Return the accounts, for changes by the user of the call."""
    panel = call.panel
    return Accounts(panel.users, panel.tokens, panel.results, call.someone)


@router.get("/users", response_model=_Users)
def _users(call: ByAdministrator) -> dict[str, Any]:
    """The users."""
    return {"users": call.panel.users.all()}


@router.post("/users", status_code=201, response_model=_Account)
def _put_user(call: ByAdministrator, body: UserFields) -> AccountFields:
    """Add a user, or give one another role and password."""
    _accounts_of(call).put_user(body.name, body.role, body.password)
    return body


@router.delete("/users/{name}", response_model=_Removed)
def _remove_user(call: ByAdministrator, name: str) -> dict[str, Any]:
    """Remove a user."""
    _accounts_of(call).remove_user(name)
    return {"name": name, "removed": True}


@router.get("/tokens", response_model=_Clients)
def _clients(call: ByAdministrator) -> dict[str, Any]:
    """The API clients."""
    return {"clients": call.panel.tokens.all()}


@router.post("/tokens", status_code=201, response_model=_NewClient)
def _add_client(call: ByAdministrator, body: AccountFields) -> dict[str, Any]:
    """Add an API client; the answer has its token, which is not stored."""
    return {**body.model_dump(), "token": _accounts_of(call).add_client(body.name, body.role)}


@router.delete("/tokens/{name}", response_model=_Removed)
def _remove_client(call: ByAdministrator, name: str) -> dict[str, Any]:
    """Remove an API client."""
    _accounts_of(call).remove_client(name)
    return {"name": name, "removed": True}


@pages.get("/accounts")
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


@pages.post("/accounts")
def _change_accounts(call: ByAdministrator) -> Response:
    """Add or remove a user or an API client."""
    accounts, action, name = _accounts_of(call), call.text("action"), call.text("name")
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
    except InputError as error:
        return _accounts_page(call, message=str(error))
    return RedirectResponse("/accounts", 303)


def _role_of(call: Call) -> Role:
    text = call.text("role")
    if text not in tuple(Role):
        raise InputError(f"role = {text[:20]!r}: give {', '.join(Role)}")
    return Role(text)


@pages.get("/changes")
def _changes(call: ByEngineer) -> Response:
    """Who changed what."""
    changes = newest_changes(call.panel.results.store, _SHOWN_CHANGES)
    return page(call, "changes.html", changes=changes, most=_SHOWN_CHANGES)


@pages.get("/password")
def _password(call: ByOperator) -> Response:
    """The form for another password."""
    return _password_form(call)


def _password_form(call: Call, message: str = "") -> Response:
    return page(call, "password.html", 400 if message else 200, message=message)


@pages.post("/password")
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
        _accounts_of(call).put_user(user.name, user.role, call.text("new"), user)
    except InputError as error:
        return _password_form(call, str(error))
    return RedirectResponse("/login", 303)
