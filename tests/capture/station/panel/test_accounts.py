"""Users and tokens: files, commands, and the log of changes."""

import json
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.base.folder_lock import file_lock
from capture.sets.captured_set import CapturedSet
from capture.station.domain.folder import make_station
from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.users import MAX_PASSWORD_LENGTH, Role, Tokens, Users
from capture.station.panel.sessions import (
    FAILURES_OF_A_NAME,
    IDLE_S,
    MAX_SESSION_S,
    MAX_SESSIONS,
    Sessions,
)
from classify.base.errors import InputError
from tests.capture.station.panel.panels import PASSWORD, RunningPanel, running_panel


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_station(tmp_path / "line-1")
    return tmp_path / "line-1"


def test_a_password_is_kept_as_a_hash_that_only_the_owner_may_read(folder: Path) -> None:
    users = Users(folder)
    users.put("ada", Role.ENGINEER, PASSWORD)
    text = (folder / "users.json").read_text()
    assert "$argon2id$" in text
    assert PASSWORD not in text
    assert stat.S_IMODE((folder / "users.json").stat().st_mode) == 0o600
    assert users.verified("ada", PASSWORD) == users.get("ada")
    assert users.verified("ada", PASSWORD + "x") is None
    assert users.verified("kim", PASSWORD) is None
    assert users.verified("ada", 300 * "x") is None


def test_a_password_is_the_same_however_it_is_typed(folder: Path) -> None:
    """An accent as one character, or as two."""
    users = Users(folder)
    users.put("ada", Role.ENGINEER, "caf\u00e9 caf\u00e9")
    assert users.verified("ada", "cafe\u0301 cafe\u0301") is not None


def test_the_normal_form_of_a_password_is_bounded(folder: Path) -> None:
    users, accents = Users(folder), MAX_PASSWORD_LENGTH * "e\u0301"
    users.put("ada", Role.ENGINEER, accents)
    assert users.verified("ada", accents) is not None
    assert users.verified("ada", accents + "x") is None


def test_a_password_that_no_encoding_holds_is_refused(folder: Path) -> None:
    users = Users(folder)
    with pytest.raises(InputError, match="UTF-8"):
        users.put("ada", Role.ENGINEER, 8 * "\udcfc")
    users.put("ada", Role.ENGINEER, PASSWORD)
    assert users.verified("ada", "\ud800") is None


@pytest.mark.parametrize("password", ["", "7 chars", (MAX_PASSWORD_LENGTH + 1) * "x"])
def test_a_password_has_bounds(folder: Path, password: str) -> None:
    with pytest.raises(InputError, match=f"this one has {len(password)}"):
        Users(folder).put("ada", Role.ENGINEER, password)
    assert not (folder / "users.json").exists()


@pytest.mark.parametrize("name", ["", "a b", "../x", "x" * 101, "é"])
def test_a_name_has_bounds(folder: Path, name: str) -> None:
    with pytest.raises(InputError, match="up to 100 letters"):
        Users(folder).put(name, Role.ENGINEER, PASSWORD)
    with pytest.raises(InputError, match="up to 100 letters"):
        Tokens(folder).add(name, Role.ENGINEER)


def test_the_last_administrator_stays_while_there_are_others(folder: Path) -> None:
    users = Users(folder)
    users.put("ada", Role.ADMINISTRATOR, PASSWORD)
    users.put("kim", Role.OPERATOR, PASSWORD)
    with pytest.raises(InputError, match="is the last administrator"):
        users.remove("ada")
    with pytest.raises(InputError, match="is the last administrator"):
        users.put("ada", Role.OPERATOR, PASSWORD)
    users.remove("kim")
    users.remove("ada")
    assert users.all() == ()


def test_users_that_are_added_at_the_same_moment_are_all_kept(folder: Path) -> None:
    users = Users(folder)
    threads = [
        threading.Thread(target=users.put, args=(f"user-{n}", Role.OPERATOR, PASSWORD))
        for n in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(users.all()) == 4


def test_a_file_that_another_program_holds_is_left_as_it_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("capture.station.domain.private_file.TIMEOUT_S", 0.1)
    with (
        file_lock(folder / "users.json", 0.0),
        pytest.raises(InputError, match=r"users\.json: another program changes it; try again"),
    ):
        Users(folder).put("ada", Role.ENGINEER, PASSWORD)
    assert Users(folder).all() == ()


@pytest.mark.parametrize(
    "text",
    ["{", '{"users": [{"name": "a", "role": "king", "password": "x"}]}', 10_000 * "["],
)
def test_a_damaged_file_lets_nobody_in_and_is_named(folder: Path, text: str) -> None:
    (folder / "users.json").write_text(text)
    with pytest.raises(InputError, match="users\\.json"):
        Users(folder).all()


def test_a_damaged_file_of_users_closes_the_panel(panel: RunningPanel) -> None:
    """Without users this machine may operate; with a file that cannot be read it may not."""
    (panel.bench.folder.path / "users.json").write_text("{")
    assert panel.local.get("/api/v1/state").status == 400
    assert panel.local.post("/api/v1/trigger").status == 400


def test_a_token_is_kept_as_a_hash(folder: Path) -> None:
    tokens = Tokens(folder)
    token = tokens.add("mes", Role.OPERATOR)
    assert token not in (folder / "tokens.json").read_text()
    assert stat.S_IMODE((folder / "tokens.json").stat().st_mode) == 0o600
    found = Tokens(folder).find(token)
    assert (found.name, found.role) == ("mes", Role.OPERATOR)
    assert tokens.find(token + "x") is None
    assert tokens.find("\udcff") is None
    with pytest.raises(InputError, match="there is one already"):
        tokens.add("mes", Role.ENGINEER)
    tokens.remove("mes")
    assert tokens.find(token) is None
    with pytest.raises(InputError, match="no such"):
        tokens.remove("mes")


def test_sessions_end_by_time_and_their_number_is_bounded(folder: Path) -> None:
    now_s = [0.0]
    users = Users(folder)
    users.put("ada", Role.ENGINEER, PASSWORD)
    user = users.all()[0]
    sessions = Sessions(folder, users, lambda: now_s[0])
    idle = sessions.begin(user)
    now_s[0] = IDLE_S + 1
    assert sessions.find(idle) is None
    busy = sessions.begin(user)
    while now_s[0] < MAX_SESSION_S + 3 * IDLE_S:
        found = sessions.find(busy)
        now_s[0] += IDLE_S / 2
    assert found is None
    first = sessions.begin(user)
    for _ in range(MAX_SESSIONS):
        now_s[0] += 0.001
        sessions.begin(user)
    assert sessions.find(first) is None


def restarted(folder: Path, now_s: float = 0.0) -> Sessions:
    """The sessions of a panel that has just been started."""
    return Sessions(folder, Users(folder), lambda: now_s)


def test_a_session_outlives_the_panel_and_has_the_present_role(folder: Path) -> None:
    users, now_s = Users(folder), [0.0]
    users.put("ada", Role.ADMINISTRATOR, PASSWORD)
    users.put("kim", Role.ENGINEER, PASSWORD)
    sessions = Sessions(folder, users, lambda: now_s[0])
    ada, kim = (sessions.begin(user) for user in users.all())
    before = sessions.find(kim)
    assert restarted(folder).find(kim) == before
    assert restarted(folder, MAX_SESSION_S).find(kim) == before
    assert restarted(folder, MAX_SESSION_S + 1.0).find(kim) is None
    after = restarted(folder)
    other = after.find(ada)
    assert other.csrf != before.csrf
    mode = (folder / "sessions.json").stat().st_mode
    assert stat.S_IMODE(mode) == 0o600
    # Users are looked up at each request.
    removed = users.get("kim")
    users.remove("kim")
    assert after.find(kim) is None
    users.put("kim", Role.ENGINEER, PASSWORD)
    assert users.get("kim") != removed
    assert after.find(kim) is None


def test_damaged_sessions_are_named_with_the_way_out(folder: Path) -> None:
    (folder / "sessions.json").write_text("{")
    with pytest.raises(InputError, match=r"sessions\.json: damaged: .*; remove it"):
        restarted(folder).find("x")


def test_a_session_that_somebody_ended_stays_ended_after_a_restart(folder: Path) -> None:
    users = Users(folder)
    users.put("ada", Role.ENGINEER, PASSWORD)
    sessions, user = restarted(folder), users.all()[0]
    ended, other = sessions.begin(user), sessions.begin(user)
    sessions.end(ended)
    sessions.end("x")
    for panel in (sessions, restarted(folder)):
        assert panel.find(ended) is None
        assert panel.find(other) is not None
    later = Sessions(folder, users, lambda: MAX_SESSION_S + 1.0)
    later.end(later.begin(user))
    assert len(json.loads((folder / "sessions.json").read_text())["ended"]) == 1


def test_a_session_that_the_station_did_not_sign_is_refused(folder: Path, tmp_path: Path) -> None:
    make_station(tmp_path / "line-2")
    for place in (folder, tmp_path / "line-2"):
        Users(place).put("ada", Role.ENGINEER, PASSWORD)
    foreign = restarted(tmp_path / "line-2").begin(Users(folder).all()[0])
    assert restarted(folder).find(foreign) is None  # there is no key yet
    sessions = restarted(folder)
    own = sessions.begin(Users(folder).all()[0])
    for cookie in (foreign, own[:-1], own.rpartition(".")[0], "", "\u00ff", own + "x"):
        assert sessions.find(cookie) is None
    assert sessions.find(own) is not None


def test_an_idle_session_does_not_begin_again(folder: Path) -> None:
    now_s = [0.0]
    users = Users(folder)
    users.put("ada", Role.ENGINEER, PASSWORD)
    idle = restarted(folder).begin(users.all()[0])
    now_s[0] = 100.0
    sessions = Sessions(folder, users, lambda: now_s[0])
    for now_s[0] in (101.0 + IDLE_S, 102.0 + IDLE_S):
        assert sessions.find(idle) is None


SCREEN = PanelConfig(port=0, kiosk_addresses=["127.0.0.1"])
PIN = "493817"


def test_a_screen_of_the_line_logs_in_with_a_pin(
    tmp_path: Path, captured: CapturedSet, ps4rig: Callable[..., Any]
) -> None:
    with running_panel(tmp_path / "line-1", captured, SCREEN) as panel:
        folder = panel.bench.folder.path
        users, screen = panel.panel.users, panel.local
        assert 'name="pin"' not in screen.get("/login").text
        for pin in ("12345", "12345x", "1234567890123", "correct horse"):
            assert ps4rig("station", "user", "kiosk", folder, typed=f"{pin}\n").exit_code == 2
        assert ps4rig("station", "user", "kiosk", folder, typed=f"{PIN}\n").exit_code == 0
        assert PIN not in (folder / "users.json").read_text()
        assert 'name="pin"' in screen.get("/login").text
        assert screen.log_in("kiosk", PIN).status == 401  # a PIN is no password
        assert screen.log_in("", pin="000000").status == 401
        assert screen.log_in("", pin=PIN).status == 303
        assert screen.get("/accounts").status == 403
        panel.until_ready()
        assert screen.post("/api/v1/trigger").status == 403  # without the token of the page
        assert screen.post("/api/v1/trigger", X_CSRF_Token=screen.csrf).status == 202
        row = panel.client(Role.ENGINEER).get("/api/v1/audit").json["changes"][0]
        assert (row["what"], row["via"], row["after"]) == ("login as kiosk", "kiosk", "failed")
        users.put("kiosk", Role.OPERATOR, "493818")
        assert screen.get("/api/v1/state").status == 401
        for _ in range(FAILURES_OF_A_NAME):
            assert screen.log_in("", pin=PIN).status == 401
        assert screen.log_in("", pin="493818").status == 429


def test_another_address_cannot_use_the_pin(panel: RunningPanel) -> None:
    panel.panel.users.put("kiosk", Role.OPERATOR, PIN)
    assert 'name="pin"' not in panel.local.get("/login").text
    assert panel.local.log_in("", pin=PIN).status == 401


def test_commands_add_list_and_remove_users_and_tokens(
    folder: Path, ps4rig: Callable[..., Any]
) -> None:
    add = ("station", "user", "add", folder, "ada", "--role", "administrator")
    added = ps4rig(*add, typed=f"{PASSWORD}\n")
    assert (added.exit_code, added.stdout) == (0, "user ada: administrator\n")
    assert ps4rig(*add, typed="short\n").exit_code == 2
    assert "ada" in ps4rig("station", "user", "list", folder).stdout
    token = ps4rig("station", "token", "add", folder, "mes", "--role", "operator").stdout.strip()
    found = Tokens(folder).find(token)
    assert found.name == "mes"
    assert "mes" in ps4rig("station", "token", "list", folder).stdout
    assert ps4rig("station", "token", "remove", folder, "mes").exit_code == 0
    assert ps4rig("station", "user", "remove", folder, "ada").exit_code == 0
    assert ps4rig("station", "user", "remove", folder, "ada").exit_code == 2
    log = (folder / "station.log").read_text()
    assert "user ada: nothing -> administrator, new password" in log
    assert "on the terminal (administrator, command): client mes: nothing -> operator" in log
    assert log.count("user ada") == 2  # one change failed
    assert PASSWORD not in log
    assert token not in log


def test_an_administrator_changes_accounts_by_the_api_and_each_change_has_a_row(
    panel: RunningPanel,
) -> None:
    panel.until_ready()
    admin = panel.client(Role.ADMINISTRATOR)
    user = {"name": "kim", "role": "operator", "password": PASSWORD}
    assert admin.post("/api/v1/users", user).status == 201
    wrong = admin.post("/api/v1/users", user | {"role": "king"})
    assert (wrong.status, wrong.json["error"].partition(":")[0]) == (400, "role")
    assert admin.get("/api/v1/users").json == {"users": [{"name": "kim", "role": "operator"}]}
    made = admin.post("/api/v1/tokens", {"name": "mes", "role": "operator"}).json
    assert panel.panel.tokens.find(made["token"]) is not None
    assert made["token"] not in json.dumps(admin.get("/api/v1/tokens").json)
    assert admin.ask("DELETE", "/api/v1/tokens/mes").status == 200
    assert admin.ask("DELETE", "/api/v1/users/kim").status == 200
    assert admin.ask("DELETE", "/api/v1/users/kim").status == 404
    rows = [(row["what"], row["before"], row["after"]) for row in
            admin.get("/api/v1/audit").json["changes"]]  # fmt: skip
    assert rows == [
        ("user kim", "operator", None),
        ("client mes", "operator", None),
        ("client mes", None, "operator"),
        ("user kim", None, "operator, new password"),
    ]


@pytest.mark.parametrize("name", ["PLC", "root", "Station", "kiosk"])
def test_names_of_others_in_the_log_of_changes_are_reserved(
    tmp_path: Path, ps4rig: Callable[..., Any], name: str
) -> None:
    make_station(tmp_path / "line")
    add = ("add", tmp_path / "line", name, "--role", "operator")
    assert ps4rig("station", "token", *add).exit_code == 2
    assert ps4rig("station", "user", *add, typed="a long password\n").exit_code == 2
    assert not (tmp_path / "line" / "tokens.json").exists()
