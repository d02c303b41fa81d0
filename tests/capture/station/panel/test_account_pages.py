"""Pages of accounts, changes and passwords, as a browser without JavaScript uses them."""

import re

import pytest

from capture.station.domain.users import Role, User
from tests.capture.station.panel.panels import PASSWORD, Client, RunningPanel


@pytest.fixture
def browser(panel: RunningPanel) -> Client:
    """An administrator, of a station that has run."""
    panel.until_ready()
    panel.panel.users.put("ada", Role.ADMINISTRATOR, PASSWORD)
    client = panel.local
    client.log_in("ada")
    return client


def test_an_administrator_adds_and_removes_users(panel: RunningPanel, browser: Client) -> None:
    user = {"action": "put user", "name": "kim", "role": "engineer", "password": PASSWORD}
    assert browser.form("/accounts", **user).status == 303
    text = browser.get("/accounts").text
    assert "<td>kim</td><td>engineer</td>" in text
    # The button that removes her comes after a first press.
    assert re.search(r'<details><summary[^>]*kim">Remove</summary>\n<form [^>]*>', text)
    kim = panel.local
    assert 'aria-label="Pages"' not in kim.get("/nowhere").text
    assert kim.log_in("kim").status == 303
    assert kim.get("/accounts").status == 403
    for path in ("/nowhere", "/parts/nobody"):
        answer = kim.get(path)
        assert (answer.status, 'aria-label="Pages"' in answer.text) == (404, True)
    assert browser.form("/accounts", action="remove user", name="kim").status == 303
    assert kim.get("/").status == 303  # to the login
    changes = browser.get("/changes").text
    removed = '<td>user kim</td><td data-label="From">engineer</td>'
    assert changes.index(removed) < changes.index("new password")


@pytest.mark.parametrize(
    "change",
    [
        {"action": "put user", "role": "engineer", "password": "short"},
        {"action": "put user", "role": "king", "password": PASSWORD},
        {"action": "remove user"},
        {"action": "remove client"},
        {"action": "reboot"},
    ],
)
def test_a_change_that_fails_changes_nothing(browser: Client, change: dict[str, str]) -> None:
    answer = browser.form("/accounts", name="kim", **change)
    assert (answer.status, "<td>kim</td>" in answer.text) == (400, False)


def test_a_token_is_shown_once_and_works(panel: RunningPanel, browser: Client) -> None:
    made = browser.form("/accounts", action="add client", name="mes", role="operator")
    [token] = re.findall(r"<code>(ps4_[^<]+)</code>", made.text)
    client = Client(panel.url, {"Authorization": f"Bearer {token}"})
    assert client.get("/api/v1/state").status == 200
    assert token not in browser.get("/accounts").text
    assert browser.form("/accounts", action="remove client", name="mes").status == 303
    assert client.get("/api/v1/state").status == 401


def test_users_change_their_own_password(panel: RunningPanel, browser: Client) -> None:
    new = PASSWORD + "!"
    for given in (
        {"password": "wrong wrong", "new": new, "again": new},
        {"password": PASSWORD, "new": new, "again": PASSWORD},
        {"password": PASSWORD, "new": "short", "again": "short"},
    ):
        assert browser.form("/password", **given).status == 400
    assert browser.form("/password", password=PASSWORD, new=new, again=new).status == 303
    assert browser.get("/api/v1/state").status == 401
    assert panel.local.log_in("ada", PASSWORD).status == 401
    assert panel.local.log_in("ada", new).status == 303
    token = panel.client(Role.ADMINISTRATOR)
    assert token.ask("POST", "/password", form={"password": new, "new": new}).status == 400


@pytest.mark.parametrize("role", [None, Role.OPERATOR])
def test_a_new_password_does_not_bring_back_what_an_administrator_took(
    panel: RunningPanel, browser: Client, monkeypatch: pytest.MonkeyPatch, role: Role | None
) -> None:
    users, new = panel.panel.users, PASSWORD + "!"
    assert browser.get("/accounts").status == 200
    users.put("kim", Role.ENGINEER, PASSWORD)
    kim = panel.local
    kim.log_in("kim")
    verified = users.verified

    def verified_before_the_change(name: str, password: str) -> User | None:
        user = verified(name, password)
        users.remove("kim")
        if role is not None:
            users.put("kim", role, PASSWORD)
        return user

    monkeypatch.setattr(users, "verified", verified_before_the_change)
    answer = kim.form("/password", password=PASSWORD, new=new, again=new)
    assert (answer.status, "was changed meanwhile" in answer.text) == (400, True)
    found = users.get("kim")
    assert (None if found is None else found.role) == role
