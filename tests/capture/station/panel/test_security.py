"""Attacks over real sockets: other hosts and sites, sizes, slowness, paths, cookies, logins."""

import http.client
import shutil
import socket
import ssl
import time
from contextlib import ExitStack, closing, suppress
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import BinaryIO
from urllib.parse import urlsplit

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.folder import make_station
from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.users import Role, Users
from capture.station.panel import api, event_stream, security, server
from capture.station.panel.security import MAX_BODY_BYTES, Slots, is_own_host
from capture.station.panel.server import MAX_CONNECTIONS, MAX_CONNECTIONS_OF_AN_ADDRESS, REFUSED_S
from capture.station.panel.sessions import (
    FAILURES_OF_A_NAME,
    FAILURES_OF_AN_ADDRESS,
    MAX_LOGINS_AT_ONCE,
    LoginLimit,
)
from capture.station.results.audit import newest_changes
from capture.station.run.events import JsonEvent
from classify.base.errors import InputError
from tests.capture.station.panel.panels import PASSWORD, Client, RunningPanel, running_panel
from tests.capture.station.panel.routes import ROUTES
from tests.memory_growth import growth_bytes
from tests.waiting import until_so

# For a deadline in tests, and for a busy machine to keep to it.
SHORT_S, LONG_S = 0.2, 30.0
# Signed by itself, for 127.0.0.1, and trusted by nobody else.
CERTIFICATE = Path(__file__).parents[3] / "data" / "panel"


def connected(panel: RunningPanel, address: str = "127.0.0.1") -> socket.socket:
    parts = urlsplit(panel.url)
    return socket.create_connection((parts.hostname, parts.port), LONG_S, (address, 0))


def answer_to(panel: RunningPanel, text: bytes) -> bytes:
    """Send bytes and read until the server closes the connection."""
    with connected(panel) as raw:
        raw.sendall(text.replace(b"HOST", urlsplit(panel.url).netloc.encode()))
        read = b""
        while block := raw.recv(65536):
            read += block
        return read


# Hosts and sites.


def test_another_name_of_this_machine_is_refused(without_users: RunningPanel) -> None:
    """DNS rebinding: the page of another site asks for its own name."""
    for path in ("/", "/static/panel.css", "/api/v1/state", "/nowhere"):
        answer = without_users.local.get(path, Host="evil.example")
        assert (answer.status, "Host 'evil.example'" in answer.text) == (421, True)
    both = b"GET / HTTP/1.1\r\nHost: HOST\r\nHost: evil.example\r\nConnection: close\r\n\r\n"
    for several_or_none in (both, b"GET / HTTP/1.0\r\n\r\n"):
        assert answer_to(without_users, several_or_none).split()[1] in (b"400", b"421")


@pytest.mark.parametrize(
    ("host", "address", "accepted"),
    [
        ("localhost:8100", "127.0.0.1", True),
        ("LOCALHOST", "::1", True),
        ("[::1]:8100", "127.0.0.1", True),
        ("127.0.0.1.evil.example", "127.0.0.1", False),
        ("127.0.0.2", "127.0.0.1", False),
        ("line-3.example", "192.0.2.7", True),
        ("LINE-3.example:8443", "::ffff:192.0.2.7", True),
        ("192.0.2.7:8443", "::ffff:192.0.2.7", True),
        ("192.0.2.8", "192.0.2.7", False),
        ("localhost", "192.0.2.7", False),
        ("line-3.example@evil.example", "192.0.2.7", False),
        ("[::1", "192.0.2.7", False),
        ("", "192.0.2.7", False),
    ],
)
def test_only_names_and_addresses_of_the_station_are_accepted(
    host: str, address: str, accepted: bool
) -> None:
    assert is_own_host(host, address, ("line-3.example",)) is accepted


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
)
def test_a_change_that_another_site_sends_is_refused(
    panel: RunningPanel, headers: dict[str, str]
) -> None:
    panel.until_ready()
    for path in ("/api/v1/trigger", "/login", "/logout"):
        answer = panel.local.post(path, **headers)
        assert answer.status == 403
        for named in (panel.local.host, *headers.values(), "proxy_set_header Host"):
            assert named in answer.text
    assert panel.bench.rows() == []
    own = {"Origin": panel.url.rstrip("/"), "Sec_Fetch_Site": "same-origin"}
    assert panel.local.post("/api/v1/trigger", **own).status == 202


def test_a_change_of_a_session_needs_its_token(with_users: RunningPanel) -> None:
    browser, other = with_users.local, with_users.local
    browser.log_in("operator")
    other.log_in("operator")
    changes = [r for r in ROUTES if r.method != "GET" and r.role is Role.OPERATOR]
    assert len(changes) >= 3
    for route in changes:
        path = route.path.format(part_id="nobody")
        for token in ("", "x", "\u00e9", other.csrf):
            answer = browser.ask(route.method, path, form={"csrf": token})
            assert answer.status == 403, route
        assert browser.ask(route.method, path).status == 403, route
    with_users.until_ready()
    assert browser.post("/api/v1/trigger", X_CSRF_Token=browser.csrf).status == 202


# Headers.


def test_every_answer_has_the_headers_that_protect_it(with_users: RunningPanel) -> None:
    client = with_users.client(Role.OPERATOR)
    for path in ("/", "/login", "/static/panel.css", "/api/v1/state", "/nowhere", "/api/v1/x"):
        headers = client.get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"
        assert headers["referrer-policy"] == "same-origin"
        assert "server" not in headers


# Paths.


@pytest.mark.parametrize(
    "path",
    [
        "/static/..%2f..%2fserver.py",
        "/..%2fusers.json",
        "/api/v1/parts/..%2f..%2fusers.json/set",
        "/api/v1/parts/%2e%2e/set",
        "/api/v1/recipes/..%2f..%2fstation",
        "/api/v1/recipes/%2fetc%2fpasswd",
    ],
)
def test_a_path_leads_out_of_no_folder(with_users: RunningPanel, path: str) -> None:
    answer = with_users.client(Role.ADMINISTRATOR).get(path)
    assert answer.status in (400, 404, 405)
    assert b"argon2" not in answer.body
    assert b"import " not in answer.body
    assert b"root:" not in answer.body


def test_a_set_file_outside_of_the_parts_is_not_sent(panel: RunningPanel) -> None:
    """A row that somebody else wrote names the file of users."""
    (part_id,) = panel.parts(1)
    path = panel.bench.folder.path / panel.local.get(f"/api/v1/parts/{part_id}").json["set_file"]
    secret = panel.bench.folder.path / "users.json"
    secret.write_text("{}")
    path.unlink()
    path.symlink_to(secret)
    answer = panel.local.get(f"/api/v1/parts/{part_id}/set")
    assert answer.status == 404
    assert "is missing" in answer.json["error"]


@pytest.mark.parametrize(
    "place", ["//evil.example", "/\\evil.example", "https://evil.example", "javascript:1", "/\t/x"]
)
def test_a_login_leads_to_no_other_site(with_users: RunningPanel, place: str) -> None:
    form = {"name": "operator", "password": PASSWORD, "next": place}
    assert with_users.local.ask("POST", "/login", form=form).headers["location"] == "/"


# Sizes.


def test_a_large_body_is_refused_before_it_is_read(without_users: RunningPanel) -> None:
    head = b"POST /api/v1/trigger HTTP/1.1\r\nHost: HOST\r\nContent-Type: application/json\r\n"
    length = b"Content-Length: %d\r\n\r\n" % (1 << 40)
    assert answer_to(without_users, head + length + b"x").split()[1] == b"413"
    chunk = b"%x\r\n" % (MAX_BODY_BYTES + 1) + (MAX_BODY_BYTES + 1) * b"x" + b"\r\n"
    chunked = answer_to(without_users, head + b"Transfer-Encoding: chunked\r\n\r\n" + chunk)
    assert chunked.split()[1] == b"413"


TRIGGER, FORM = "/api/v1/trigger", "application/x-www-form-urlencoded"


@pytest.mark.parametrize(
    ("path", "kind", "body", "status"),
    [
        (TRIGGER, "application/json", b'{"part_id": 7}', 400),
        (TRIGGER, "application/json", 60_000 * b"[", 400),
        (TRIGGER, "application/json", b"\xff\xfe", 400),
        (TRIGGER, FORM, b"part_id=A-1", 415),
        ("/login", FORM, 2 * security.MAX_FIELDS * b"a=b&", 400),
        ("/login", FORM, b"a=%ff", 400),
    ],
)
def test_a_body_of_another_form_is_refused(
    without_users: RunningPanel, path: str, kind: str, body: bytes, status: int
) -> None:
    head = f"POST {path} HTTP/1.1\r\nHost: HOST\r\nConnection: close\r\n"
    about = f"Content-Type: {kind}\r\nContent-Length: {len(body)}\r\n\r\n"
    assert int(answer_to(without_users, (head + about).encode() + body).split()[1]) == status


@pytest.mark.parametrize("rest", [b"", b"zz\r\n", b"GET / HTTP/1.1\r\n\x00\r\n\r\n", b"\x00\r\n"])
@pytest.mark.parametrize("begin", [
    b"POST /api/v1/trigger HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: elsewhere\r\nTransfer-Encoding: chunked\r\n\r\n",
    b"HEAD / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n",
    b"",
])  # fmt: skip
@pytest.mark.parametrize("wait_s", [0.0, 0.05])
def test_a_malformed_request_is_no_error_of_the_panel(
    without_users: RunningPanel,
    caplog: pytest.LogCaptureFixture,
    begin: bytes,
    rest: bytes,
    wait_s: float,
) -> None:
    """Its answer may be on the way when the rest of it arrives."""
    with connected(without_users) as raw:
        raw.sendall(begin if wait_s else begin + rest)
        time.sleep(wait_s)
        with suppress(OSError):  # the panel may have closed the connection
            raw.sendall(rest if wait_s else b"")
            raw.shutdown(socket.SHUT_WR)
            while raw.recv(1 << 16):
                pass
    assert without_users.local.get("/").status == 200
    assert not [each for each in caplog.records if each.levelname == "ERROR"]


# Slowness.


@pytest.fixture
def hurried(tmp_path: Path, captured: CapturedSet, monkeypatch: pytest.MonkeyPatch) -> RunningPanel:
    """Make the deadlines short."""
    monkeypatch.setattr(server, "HEAD_S", SHORT_S)
    monkeypatch.setattr(server, "SEND_S", SHORT_S)
    monkeypatch.setattr(security, "BODY_S", SHORT_S)
    with running_panel(tmp_path / "line-1", captured) as running:
        yield running


def drip(panel: RunningPanel, head: bytes) -> bytes:
    """Send a byte now and then until the server answers or closes; return its answer."""
    with connected(panel) as raw:
        sent = head.replace(b"HOST", urlsplit(panel.url).netloc.encode())
        raw.settimeout(0.05)
        given_up_s = time.monotonic() + LONG_S
        while True:
            assert time.monotonic() < given_up_s, "the connection stays open"
            with suppress(OSError):  # it has closed; its answer may be there
                raw.sendall(sent)
            sent = b"x"
            try:
                return raw.recv(65536)
            except TimeoutError:
                pass
            except OSError:
                return b""


def test_a_slow_head_is_cut_off(hurried: RunningPanel, monkeypatch: pytest.MonkeyPatch) -> None:
    assert drip(hurried, b"GET / HTTP/1.1\r\nX-Slow: ") == b""
    # Also the second one of a connection, whose first is served; a busy machine may send it late.
    snapshot, hurry = hurried.live.snapshot, partial(monkeypatch.setattr, server, "HEAD_S")
    hurry(LONG_S)
    monkeypatch.setattr(hurried.live, "snapshot", lambda: hurry(SHORT_S) or snapshot())
    with connected(hurried) as raw:
        host = urlsplit(hurried.url).netloc.encode()
        raw.sendall(b"GET /api/v1/state HTTP/1.1\r\nHost: " + host + b"\r\n\r\nGET /")
        assert raw.recv(65536).startswith(b"HTTP/1.1 200")
        while raw.recv(65536):
            pass


def test_a_slow_body_is_refused(hurried: RunningPanel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "HEAD_S", LONG_S)
    head = b"POST /login HTTP/1.1\r\nHost: HOST\r\nContent-Length: 5000\r\n\r\n"
    assert drip(hurried, head).split()[1] == b"408"


def test_a_panel_that_ends_cuts_off_an_export_without_a_traceback(
    tmp_path: Path,
    captured: CapturedSet,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(server, "STOP_S", SHORT_S)
    monkeypatch.setattr(api, "csv_pieces", lambda _: repeat("x" * 1000))
    with ExitStack() as stack, running_panel(tmp_path / "line-1", captured) as running:
        raw = stack.enter_context(connected(running))  # is closed after the panel
        host = urlsplit(running.url).netloc.encode()
        raw.sendall(b"GET /api/v1/parts.csv HTTP/1.1\r\nHost: " + host + b"\r\n\r\n")
        assert raw.recv(100).startswith(b"HTTP/1.1 200")
    assert not [each for each in caplog.records if each.exc_info]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("buffer_bytes", "event_bytes"),
    # Linux drops what arrives at a buffer that has shrunk. Far less then waits in the station.
    [pytest.param(4096, 100_000, id="fills up"), pytest.param(1, 1000, id="drops events")],
)
def test_a_client_that_does_not_read_is_cut_off(
    hurried: RunningPanel,
    monkeypatch: pytest.MonkeyPatch,
    buffer_bytes: int,
    event_bytes: int,
) -> None:
    monkeypatch.setattr(server, "HEAD_S", LONG_S)
    host = urlsplit(hurried.url).netloc.encode()
    with connected(hurried) as raw:
        raw.sendall(b"GET /api/v1/events HTTP/1.1\r\nHost: " + host + b"\r\n\r\n")
        read = b""
        while b"retry:" not in read:  # the first line of the stream
            block = raw.recv(100)
            assert block, "the connection is closed"
            read += block
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
        given_up_s = time.monotonic() + LONG_S
        assert hurried.live.snapshot().subscribers == 1
        while hurried.live.snapshot().subscribers:
            assert time.monotonic() < given_up_s, "the stream stays open"
            hurried.live.publish(JsonEvent({"event": "filler", "text": event_bytes * "x"}))
            time.sleep(0.01)


def test_the_connections_of_one_address_leave_room_for_others(panel: RunningPanel) -> None:
    idle = [connected(panel, "127.0.0.2") for _ in range(MAX_CONNECTIONS_OF_AN_ADDRESS)]
    try:
        began_s = time.monotonic()
        with connected(panel, "127.0.0.2") as raw, suppress(ConnectionError):
            raw.sendall(b"GET / HTTP/1.1\r\n")
            assert raw.recv(1) == b""
        # A client that tries again at once does not keep the processor busy.
        assert time.monotonic() - began_s > 0.9 * REFUSED_S
        assert panel.local.get("/api/v1/state").status == 200
    finally:
        for each in idle:
            each.close()


def test_streams_that_are_asked_for_at_once_have_one_limit(
    with_users: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(with_users.panel, "event_streams", Slots(2, "event streams are open"))
    token = with_users.client(Role.OPERATOR).headers["Authorization"]
    head = ("GET /api/v1/events HTTP/1.1", f"Host: {with_users.local.host}",
            f"Authorization: {token}", "", "")  # fmt: skip
    for _ in range(2):  # the places are free again when the clients are gone
        with ExitStack() as connections:
            raws = [connections.enter_context(connected(with_users)) for _ in range(8)]
            for raw in raws:
                raw.sendall("\r\n".join(head).encode())
            answers = [raw.recv(len(b"HTTP/1.1 200")) for raw in raws]
        assert sorted(answers) == [b"HTTP/1.1 200"] * 2 + [b"HTTP/1.1 503"] * 6
        until_so(lambda: not with_users.live.snapshot().subscribers)


def test_the_oldest_stream_of_one_client_ends(
    with_users: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_stream, "MAX_STREAMS_OF_ONE_CLIENT", 2)
    tokens = [with_users.client(role).headers["Authorization"] for role in Role]
    with ExitStack() as open_streams:

        def stream(token: str) -> BinaryIO:
            raw = open_streams.enter_context(connected(with_users))
            head = ("GET /api/v1/events HTTP/1.1", f"Host: {with_users.local.host}",
                    f"Authorization: {token}", "", "")  # fmt: skip
            raw.sendall("\r\n".join(head).encode())
            lines = open_streams.enter_context(raw.makefile("rb"))
            assert b"event: snapshot\n" in lines
            return lines

        other, first, second = (stream(tokens[which]) for which in (1, 0, 0))
        began_s = time.monotonic()
        third = stream(tokens[0])
        assert time.monotonic() - began_s > 0.9 * event_stream.TAKEOVER_PAUSE_S
        assert b"0\r\n" in first  # the end of the answer
        with_users.live.publish(JsonEvent({"event": "filler"}))
        for lines in (other, second, third):
            assert b"event: filler\n" in lines


def test_many_idle_connections_leave_room_for_no_more(panel: RunningPanel) -> None:
    idle = [
        connected(panel, f"127.0.0.{2 + number // MAX_CONNECTIONS_OF_AN_ADDRESS}")
        for number in range(MAX_CONNECTIONS)
    ]
    try:
        with connected(panel) as raw, suppress(ConnectionError):
            raw.sendall(b"GET / HTTP/1.1\r\n")
            assert raw.recv(1) == b""
    finally:
        for each in idle:
            each.close()
    panel.until_ready()
    given_up_s = time.monotonic() + LONG_S
    while True:
        try:
            assert panel.local.get("/api/v1/state").status == 200
            break
        except OSError:
            assert time.monotonic() < given_up_s


# Logins.


def test_the_cookie_is_out_of_reach_of_scripts_and_other_sites(with_users: RunningPanel) -> None:
    cookie = with_users.local.log_in("engineer").headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie


def test_a_wrong_password_and_an_unknown_name_get_the_same_answer(
    with_users: RunningPanel,
) -> None:
    answers = [
        with_users.local.ask("POST", "/login", form={"name": name, "password": "wrong wrong"})
        for name in ("administrator", "nobody")
    ]
    assert [answer.status for answer in answers] == [401, 401]
    assert answers[0].text == answers[1].text


def test_the_limit_counts_names_and_addresses_and_forgets() -> None:
    now_s = [0.0]
    limit = LoginLimit(lambda: now_s[0])
    for number in range(FAILURES_OF_AN_ADDRESS):
        assert limit.begin(f"name-{number}", "192.0.2.1") == 0.0
    assert limit.begin("another", "192.0.2.1") == 60.0
    assert limit.begin("another", "192.0.2.2") == 0.0
    limit.succeeded("another", "192.0.2.2")
    now_s[0] = 61.0
    assert limit.begin("another", "192.0.2.1") == 0.0


def test_few_passwords_wait_and_further_logins_are_answered_at_once(
    with_users: RunningPanel,
) -> None:
    """A flood of logins takes few of the threads that serve pages."""
    with ExitStack() as waiting:
        for number in range(MAX_LOGINS_AT_ONCE):
            waiting.enter_context(with_users.panel.logins.attempt("ada", f"192.0.2.{number}"))
        answer = with_users.local.log_in("operator")
        assert (answer.status, answer.headers["retry-after"]) == (503, "2")
    assert with_users.local.log_in("operator").status == 303


def test_the_number_of_failed_logins_that_are_counted_is_bounded() -> None:
    limit = LoginLimit(lambda: 0.0)

    def fail(first: int, last: int) -> None:
        for number in range(first, last):
            limit.begin(f"name-{number:06d}{'x' * MAX_BODY_BYTES}", f"address-{number:06d}")

    assert growth_bytes(fail, 0, 6_000, 18_000) < 100_000


def test_a_lock_outlives_the_failures_of_others() -> None:
    limit = LoginLimit(lambda: 0.0)
    for _ in range(FAILURES_OF_A_NAME):
        limit.begin("ada", "192.0.2.1")
    for number in range(12_000):
        limit.begin(f"name-{number}", f"address-{number // 20}")
    assert limit.begin("ada", "192.0.2.2") == 60.0


def test_an_address_that_was_right_is_not_shut_out_by_others() -> None:
    now_s = [0.0]
    limit = LoginLimit(lambda: now_s[0])
    assert limit.begin("ada", "192.0.2.1") == 0.0
    limit.succeeded("ada", "192.0.2.1")
    for number in range(FAILURES_OF_A_NAME):
        assert limit.begin("ada", f"192.0.2.{number + 2}") == 0.0
    assert limit.begin("ada", "192.0.2.99") == 60.0
    for number in range(FAILURES_OF_AN_ADDRESS):
        limit.begin(f"name-{number}", "192.0.2.1")
    assert limit.begin("kim", "192.0.2.1") == 60.0
    for _ in range(FAILURES_OF_A_NAME):
        assert limit.begin("ada", "192.0.2.1") == 0.0
    assert limit.begin("ada", "192.0.2.1") == 60.0
    now_s[0] = 61.0
    assert limit.begin("ada", "192.0.2.1") == 0.0


def test_a_success_at_the_limit_of_its_address_leaves_the_address_open() -> None:
    limit = LoginLimit(lambda: 0.0)
    for number in range(FAILURES_OF_AN_ADDRESS - 1):
        limit.begin(f"name-{number}", "192.0.2.1")
    assert limit.begin("ada", "192.0.2.1") == 0.0
    limit.succeeded("ada", "192.0.2.1")
    assert limit.begin("kim", "192.0.2.1") == 0.0
    assert limit.begin("lee", "192.0.2.1") == 60.0


def test_failed_logins_are_recorded_and_their_number_is_bounded(with_users: RunningPanel) -> None:
    login = {"name": "ada\n\x1b[2J", "password": "wrong wrong"}
    assert with_users.local.ask("POST", "/login", form=login).status == 401
    [row] = newest_changes(with_users.bench.store, 1)
    assert (row.by, row.role, row.via) == ("127.0.0.1", "none", "page")
    assert row.what.startswith("login as ada")
    assert row.after == "failed"
    now_s = [0.0]
    limit = LoginLimit(lambda: now_s[0])
    assert [limit.unrecorded() for _ in range(100)] == [0] * 100
    assert [limit.unrecorded() for _ in range(50)] == [None] * 50
    now_s[0] = 3600.0
    assert limit.unrecorded() == 50


# Beyond this machine.


def test_a_panel_for_other_machines_needs_https_and_users(
    tmp_path: Path, captured: CapturedSet
) -> None:
    with (
        pytest.raises(InputError, match="passwords in the clear"),
        running_panel(tmp_path / "a", captured, PanelConfig(host="0.0.0.0", port=0)),
    ):
        pass
    proxied = PanelConfig(port=0, behind_proxy=True)
    with (
        pytest.raises(InputError, match="needs users; run ps4rig station user add"),
        running_panel(tmp_path / "b", captured, proxied),
    ):
        pass


def test_a_panel_with_tls_is_reached_by_https_alone(tmp_path: Path, captured: CapturedSet) -> None:
    folder = tmp_path / "a"
    make_station(folder)
    for name in ("panel.crt", "panel.key"):
        shutil.copy(CERTIFICATE / name, folder)
    Users(folder).put("ada", Role.ADMINISTRATOR, PASSWORD)
    settings = PanelConfig(port=0, host="0.0.0.0", tls_cert="panel.crt", tls_key="panel.key")
    trusted = ssl.create_default_context(cafile=CERTIFICATE / "panel.crt")
    with running_panel(folder, captured, settings) as panel:
        port = urlsplit(panel.url).port
        assert panel.url == f"https://0.0.0.0:{port}/"
        secure = http.client.HTTPSConnection("127.0.0.1", port, context=trusted, timeout=30)
        with closing(secure):
            secure.request("GET", "/login")
            answer = secure.getresponse()
            assert answer.status == 200
            assert answer.headers["strict-transport-security"] == "max-age=31536000"
        plain = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
        with closing(plain):
            plain.request("GET", "/login")
            with pytest.raises((OSError, http.client.HTTPException)):
                plain.getresponse()


@pytest.mark.parametrize("text", ["", "no PEM", None])
def test_tls_files_that_cannot_be_used_are_named(
    tmp_path: Path, captured: CapturedSet, text: str | None
) -> None:
    make_station(tmp_path / "a")
    if text is not None:
        (tmp_path / "a" / "panel.crt").write_text(text)
    shutil.copy(CERTIFICATE / "panel.key", tmp_path / "a")
    settings = PanelConfig(port=0, tls_cert="panel.crt", tls_key="panel.key")
    with (
        pytest.raises(InputError, match=r"tls_cert = .*panel\.crt.*: cannot be used"),
        running_panel(tmp_path / "a", captured, settings),
    ):
        pass


def test_a_proxy_cannot_be_passed_by() -> None:
    with pytest.raises(ValueError, match="requests could bypass the proxy"):
        PanelConfig(host="0.0.0.0", behind_proxy=True)


@pytest.mark.slow
def test_two_requests_at_once_are_both_served(
    panel: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second of a connection is an endless one: no deadline of a head may end it."""
    head_s = 2.0
    monkeypatch.setattr(server, "HEAD_S", head_s)
    host = urlsplit(panel.url).netloc.encode()
    with connected(panel) as raw:
        first = b"GET /api/v1/state HTTP/1.1\r\nHost: " + host + b"\r\n\r\n"
        raw.sendall(first + first.replace(b"state", b"events"))
        until_so(lambda: panel.live.snapshot().subscribers == 1)
        time.sleep(1.5 * head_s)
        assert panel.live.snapshot().subscribers == 1


def test_behind_a_proxy_nobody_is_local(tmp_path: Path, captured: CapturedSet) -> None:
    make_station(tmp_path / "a")
    Users(tmp_path / "a").put("ada", Role.ADMINISTRATOR, PASSWORD)
    proxied = PanelConfig(port=0, behind_proxy=True, names=("line-3.example",))
    with running_panel(tmp_path / "a", captured, proxied) as panel:
        client = Client(panel.url, {"Host": "line-3.example"})
        assert client.get("/api/v1/state").status == 401
        answer = client.log_in("ada")
        assert "Secure" in answer.headers["set-cookie"]
        assert answer.headers["strict-transport-security"] == "max-age=31536000"
        panel.panel.users.remove("ada")
        assert client.get("/api/v1/state").status == 401
        assert panel.local.get("/api/v1/state").status == 401
