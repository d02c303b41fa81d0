"""Users and API clients, for administrators."""

from starlette.responses import Response

from capture.station.domain.roles import Role
from capture.station.results.accounts import Accounts
from classify.base.errors import InputError

from .api import V1
from .render import JsonAnswer
from .routes import Call, PanelRoute


def accounts_of(call: Call) -> Accounts:
    """Return the accounts, for changes by the user of the call."""
    panel = call.panel
    return Accounts(panel.users, panel.tokens, panel.changes, call.someone)


def role_of(call: Call) -> Role:
    """Return the role of a form."""
    text = call.text("role")
    if text not in tuple(Role):
        raise InputError(f"role = {text[:20]!r}: give operator, engineer or administrator")
    return Role(text)


def _users(call: Call) -> Response:
    users = [{"name": user.name, "role": user.role} for user in call.panel.users.all()]
    return JsonAnswer({"users": users})


def _put_user(call: Call) -> Response:
    name, role = call.text("name"), role_of(call)
    accounts_of(call).put_user(name, role, call.text("password"))
    return JsonAnswer({"name": name, "role": role}, 201)


def _remove_user(call: Call) -> Response:
    accounts_of(call).remove_user(call.path["name"])
    return JsonAnswer({"name": call.path["name"], "removed": True})


def _clients(call: Call) -> Response:
    return JsonAnswer(
        {
            "clients": [
                {"name": client.name, "role": client.role, "created_utc": client.created_utc}
                for client in call.panel.tokens.all()
            ]
        }
    )


def _add_client(call: Call) -> Response:
    name, role = call.text("name"), role_of(call)
    token = accounts_of(call).add_client(name, role)
    return JsonAnswer({"name": name, "role": role, "token": token}, 201)


def _remove_client(call: Call) -> Response:
    accounts_of(call).remove_client(call.path["name"])
    return JsonAnswer({"name": call.path["name"], "removed": True})


_ADMIN = Role.ADMINISTRATOR
_FIELDS = {"name": "the name", "role": "operator, engineer or administrator"}
ROUTES = (
    PanelRoute("GET", f"{V1}/users", _ADMIN, _users, "The users."),
    PanelRoute(
        "POST", f"{V1}/users", _ADMIN, _put_user,
        "Add a user, or give one another role and password.",
        fields=_FIELDS | {"password": "8 to 256 characters"},
    ),
    PanelRoute("DELETE", f"{V1}/users/{{name}}", _ADMIN, _remove_user, "Remove a user."),
    PanelRoute("GET", f"{V1}/tokens", _ADMIN, _clients, "The API clients."),
    PanelRoute(
        "POST", f"{V1}/tokens", _ADMIN, _add_client,
        "Add an API client; the answer has its token, which is not stored.", fields=_FIELDS,
    ),
    PanelRoute("DELETE", f"{V1}/tokens/{{name}}", _ADMIN, _remove_client, "Remove an API client."),
)  # fmt: skip
