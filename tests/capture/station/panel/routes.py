"""Every page and API call of the panel with the role that it needs, from its routers."""

from dataclasses import dataclass
from typing import get_type_hints

from capture.station.domain.users import Role
from capture.station.panel.app import routes


@dataclass(frozen=True)
class PanelRoute:
    """A page or an API call."""

    method: str
    path: str  # names in braces are values of the path
    role: Role | None  # the lowest that may ask; None for everybody, without a login
    about: str
    is_api: bool

    @property
    def is_page(self) -> bool:
        return not self.is_api and self.method == "GET"


def _routes() -> list[PanelRoute]:
    found = []
    for route in routes():
        call = get_type_hints(route.endpoint, include_extras=True)["call"]
        scopes = getattr(call.__metadata__[0], "scopes", None)
        role = Role(*scopes) if scopes else None
        found += [
            PanelRoute(method, route.path, role, route.description, route.include_in_schema)
            for method in route.methods or ()
        ]
    return found


ROUTES = _routes()
