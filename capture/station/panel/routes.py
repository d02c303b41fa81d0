"""`PanelRoute`: a page or API call of the panel, with the role that it needs."""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from starlette.requests import Request
from starlette.responses import Response

from capture.station.domain.roles import Identity, Role
from classify.base.errors import InputError

from .panel import Panel

API = "/api/"


@dataclass(frozen=True)
class Call:
    """A request that may be served."""

    panel: Panel
    request: Request
    who: Identity | None  # None where no login is needed
    fields: Mapping[str, Any] = field(default_factory=dict)  # of its form or of its JSON object

    @property
    def someone(self) -> Identity:
        """The user or client, on a route that needs a role."""
        assert self.who is not None
        return self.who

    @property
    def name(self) -> str:
        """Name of the user or client, for records."""
        return self.someone.name

    @property
    def path(self) -> Mapping[str, Any]:
        """Values of the path."""
        return self.request.path_params

    @property
    def query(self) -> Mapping[str, str]:
        """Values of the query."""
        return self.request.query_params

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text of the form or JSON object."""
        value = self.fields.get(name, default)
        if value is None:
            raise InputError(f"{name}: missing")
        if not isinstance(value, str):
            raise InputError(f"{name}: must be a text")
        return value


Handler = Callable[[Call], Response] | Callable[[Call], Awaitable[Response]]


@dataclass(frozen=True)
class PanelRoute:
    """A page or an API call."""

    method: Literal["GET", "POST", "DELETE"]
    path: str  # names in braces are values of the path
    role: Role | None  # the lowest that may ask; None for everybody, without a login
    handler: Handler  # a plain function runs in a thread and may wait; a coroutine must not
    about: str
    query: Mapping[str, str] = field(default_factory=dict)  # names with their meanings
    # Of the form or JSON object, with their meanings.
    fields: Mapping[str, str] = field(default_factory=dict)
    # Of fields that are not texts: ``array`` or ``object``.
    types: Mapping[str, str] = field(default_factory=dict)
    answer: str = "application/json"
    menu: str = ""  # name in the menu of all pages; empty for a page that is not in the menu

    @property
    def is_api(self) -> bool:
        """Whether programs call it."""
        return self.path.startswith(API)
