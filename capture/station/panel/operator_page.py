"""The operator's page: the last verdict, to be read at five metres."""

from starlette.responses import Response

from capture.station.domain.roles import Role

from .render import page
from .routes import Call, PanelRoute


def _show(call: Call) -> Response:
    return page(call, "operator.html")


ROUTES = (
    PanelRoute(
        "GET", "/", Role.OPERATOR, _show, "The last verdict, and the state.", answer="text/html",
        menu="Station",
    ),
)  # fmt: skip
