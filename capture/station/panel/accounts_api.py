"""Users and API clients, for administrators."""

from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field, conlist

from capture.station.domain.roles import Role
from capture.station.domain.users import LONGEST_PASSWORD, SHORTEST_PASSWORD
from capture.station.results.accounts import Accounts
from classify.base.models import Record

from .answers import Name, answer
from .guard import V1, ByAdministrator, Call

router = APIRouter(prefix=V1)
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

    password: Annotated[str, Field(min_length=SHORTEST_PASSWORD, max_length=LONGEST_PASSWORD)]


def accounts_of(call: Call) -> Accounts:
    """Return the accounts, for changes by the user of the call."""
    panel = call.panel
    return Accounts(panel.users, panel.tokens, panel.changes, call.someone)


@router.get("/users", response_model=_Users)
def _users(call: ByAdministrator) -> dict[str, Any]:
    """The users."""
    return {"users": call.panel.users.all()}


@router.post("/users", status_code=201, response_model=_Account)
def _put_user(call: ByAdministrator, given: UserFields) -> AccountFields:
    """Add a user, or give one another role and password."""
    accounts_of(call).put_user(given.name, given.role, given.password)
    return given


@router.delete("/users/{name}", response_model=_Removed)
def _remove_user(call: ByAdministrator, name: str) -> dict[str, Any]:
    """Remove a user."""
    accounts_of(call).remove_user(name)
    return {"name": name, "removed": True}


@router.get("/tokens", response_model=_Clients)
def _clients(call: ByAdministrator) -> dict[str, Any]:
    """The API clients."""
    return {"clients": call.panel.tokens.all()}


@router.post("/tokens", status_code=201, response_model=_NewClient)
def _add_client(call: ByAdministrator, given: AccountFields) -> dict[str, Any]:
    """Add an API client; the answer has its token, which is not stored."""
    return {**given.model_dump(), "token": accounts_of(call).add_client(given.name, given.role)}


@router.delete("/tokens/{name}", response_model=_Removed)
def _remove_client(call: ByAdministrator, name: str) -> dict[str, Any]:
    """Remove an API client."""
    accounts_of(call).remove_client(name)
    return {"name": name, "removed": True}
