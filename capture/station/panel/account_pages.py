"""Pages of users and API clients, of changes, and of one's own password."""

from starlette.responses import RedirectResponse, Response

from capture.station.domain.roles import Role
from capture.station.results.audit import newest_changes
from capture.station.results.database import ResultsUnavailable
from classify.base.errors import InputError

from .accounts_api import accounts_of, role_of
from .login import address_of
from .render import page
from .routes import Call, PanelRoute

_SHOWN_CHANGES = 200


def _accounts(call: Call, message: str = "", token: str = "") -> Response:
    panel = call.panel
    answer = page(
        call,
        "accounts.html",
        users=panel.users.all(),
        clients=panel.tokens.all(),
        roles=tuple(Role),
        message=message,
        token=token,
    )
    answer.status_code = 400 if message else 200
    return answer


def _change_accounts(call: Call) -> Response:
    accounts, action, name = accounts_of(call), call.text("action"), call.text("name")
    try:
        if action == "put user":
            accounts.put_user(name, role_of(call), call.text("password"))
        elif action == "remove user":
            accounts.remove_user(name)
        elif action == "add client":
            return _accounts(call, token=accounts.add_client(name, role_of(call)))
        elif action == "remove client":
            accounts.remove_client(name)
        else:
            raise InputError(f"action = {action[:20]!r}: no such action")
    except ResultsUnavailable:
        raise
    except InputError as error:
        return _accounts(call, message=str(error))
    return RedirectResponse("/accounts", 303)


def _changes(call: Call) -> Response:
    changes = newest_changes(call.panel.results.store, _SHOWN_CHANGES)
    return page(call, "changes.html", changes=changes, most=_SHOWN_CHANGES)


def _password_form(call: Call, message: str = "") -> Response:
    answer = page(call, "password.html", message=message)
    answer.status_code = 400 if message else 200
    return answer


def _change_password(call: Call) -> Response:
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


_HTML = "text/html"
ROUTES = (
    PanelRoute(
        "GET", "/accounts", Role.ADMINISTRATOR, _accounts, "Users and API clients.", answer=_HTML,
        menu="Accounts",
    ),
    PanelRoute(
        "POST", "/accounts", Role.ADMINISTRATOR, _change_accounts,
        "Add or remove a user or an API client.",
        fields={
            "action": "put user, remove user, add client or remove client",
            "name": "name of the user or client", "role": "role of a new user or client",
            "password": "password of a new user",
        },
        answer=_HTML,
    ),
    PanelRoute(
        "GET", "/changes", Role.ENGINEER, _changes, "Who changed what.", answer=_HTML,
        menu="Changes",
    ),
    PanelRoute(
        "GET", "/password", Role.OPERATOR, _password_form, "The form for another password.",
        answer=_HTML,
    ),
    PanelRoute(
        "POST", "/password", Role.OPERATOR, _change_password, "Change one's own password.",
        fields={"password": "the present one", "new": "the new one", "again": "the new one again"},
        answer=_HTML,
    ),
)  # fmt: skip
