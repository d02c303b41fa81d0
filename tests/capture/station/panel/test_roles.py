"""Every page and API call with every role, and without one: ONE table decides."""

from collections.abc import Iterator

import pytest

from capture.station.domain.users import Role
from tests.capture.station.panel.panels import Client, RunningPanel
from tests.capture.station.panel.routes import ROUTES, PanelRoute

PLACES = {
    "part_id": "nobody",
    "name": "nobody",
    "version": "9",
    "file": "nothing",
    "action": "load",
}
# What a route answers to somebody who may ask: what follows finds no part, no user, no recipe, or
# an empty body. Never 401 or 403.
SERVED = {200, 202, 303, 400, 404, 409, 503}


def path_of(route: PanelRoute) -> str:
    return route.path.format(**PLACES)


def is_endless(route: PanelRoute) -> bool:
    return route.path.endswith("/events")


def status(client: Client, route: PanelRoute) -> int:
    """The status of an answer; that of an endless one is read by its head."""
    if not is_endless(route):
        return client.ask(route.method, path_of(route)).status
    import http.client

    connection = http.client.HTTPConnection(client.host, timeout=30)
    try:
        connection.request(route.method, path_of(route), headers=client.headers)
        return connection.getresponse().status
    finally:
        connection.close()


@pytest.fixture(scope="module")
def clients(with_users: RunningPanel) -> dict[Role, Client]:
    return {role: with_users.client(role) for role in Role}


def cases() -> Iterator[tuple[PanelRoute, Role]]:
    yield from ((route, role) for route in ROUTES if route.role for role in Role)


@pytest.mark.parametrize(
    ("route", "role"), list(cases()), ids=lambda each: getattr(each, "path", None) or str(each)
)
def test_a_route_serves_its_role_and_those_above_alone(
    clients: dict[Role, Client], route: PanelRoute, role: Role
) -> None:
    found = status(clients[role], route)
    if route.role is not None and role.includes(route.role):
        assert found in SERVED
    else:
        assert found == 403


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: f"{route.method} {route.path}")
def test_nobody_gets_only_what_needs_no_login(with_users: RunningPanel, route: PanelRoute) -> None:
    found = status(with_users.local, route)
    if route.role is None:
        assert found in {200, 400, 401}  # the login itself
    elif route.is_api or route.method != "GET":
        assert found == 401
    else:
        assert found == 303  # to the login


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: f"{route.method} {route.path}")
def test_a_route_without_users_serves_operators_on_this_machine(
    without_users: RunningPanel, route: PanelRoute
) -> None:
    found = status(without_users.local, route)
    if route.role in (None, Role.OPERATOR):
        assert found not in {401, 403} or route.path == "/login"
    else:
        assert found == 403


def test_no_route_is_there_twice_and_each_change_needs_a_role() -> None:
    keys = [(route.method, route.path) for route in ROUTES]
    assert len(keys) == len(set(keys))
    assert {route.path for route in ROUTES if route.role is None} == {"/login"}
    assert all(route.about.endswith(".") for route in ROUTES)


def test_malformed_json_of_nobody_is_refused_as_anything_of_nobody(
    with_users: RunningPanel, clients: dict[Role, Client]
) -> None:
    sender = with_users.local, Client(with_users.url, {"Authorization": "Bearer none"})
    found = [
        client.ask("POST", "/api/v1/trigger", form={"a": "b"}, Content_Type="application/json")
        for client in (*sender, clients[Role.OPERATOR])
    ]
    assert [answer.status for answer in found] == [401, 401, 400]
    assert found[0].headers["www-authenticate"] == "Bearer"
