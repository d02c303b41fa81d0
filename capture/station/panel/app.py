"""`panel_app`: the web application, from ONE table of routes."""

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from capture.station.panel import (
    account_pages,
    accounts_api,
    api,
    event_stream,
    history_page,
    login,
    openapi,
    part_page,
    pictures_api,
    statistics_api,
)

from .guard import endpoint_of, error_answer
from .panel import Panel
from .recipes import recipe_pages, recipes_api
from .render import STATIC
from .routes import PanelRoute
from .security import STATIC_PATH, HostRule, SecureHeaders

ROUTES: tuple[PanelRoute, ...] = (
    *login.ROUTES,
    *history_page.ROUTES,
    *part_page.ROUTES,
    *recipe_pages.ROUTES,
    *api.ROUTES,
    *pictures_api.ROUTES,
    *statistics_api.ROUTES,
    *recipes_api.ROUTES,
    *event_stream.ROUTES,
    *accounts_api.ROUTES,
    *account_pages.ROUTES,
    *openapi.ROUTES,
)
"""Every page and API call; tests try each with every role."""


def panel_app(panel: Panel) -> Starlette:
    """Return the web application of a station."""

    async def http_error(request: Request, error: Exception) -> Response:
        status = error.status_code if isinstance(error, HTTPException) else 500
        words = {404: "there is no such page", 405: f"{request.method} is not allowed here"}
        return error_answer(panel, request, status, words.get(status, "the request failed"))

    rule = HostRule(frozenset(panel.settings.names))
    app = Starlette(
        routes=[
            *(
                Route(route.path, endpoint_of(panel, route), methods=[route.method])
                for route in ROUTES
            ),
            Mount(STATIC_PATH, StaticFiles(directory=STATIC)),
        ],
        middleware=[Middleware(SecureHeaders, rule=rule, is_https=panel.settings.is_https)],
        exception_handlers={HTTPException: http_error},
    )
    app.state.routes = ROUTES
    app.state.menu = [route for route in ROUTES if route.menu]
    return app
