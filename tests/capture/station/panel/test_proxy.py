"""The panel behind nginx with TLS, configured by the example of the station's README."""

import http.client
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlencode, urlsplit

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.folder import make_station
from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.users import Role, Users
from capture.station.results.audit import newest_changes
from capture.station.run.events import JsonEvent
from tests.capture.station.panel.panels import PASSWORD, RunningPanel, running_panel
from tests.free_port import free_port
from tests.suites import NGINX

pytestmark = pytest.mark.browser
ROOT = Path(__file__).parents[4]
CERTIFICATE = ROOT / "tests" / "data" / "panel"
# The certificate is for the address; the browser asks for the name.
NAME = "line-3.example"
CLIENT = "127.0.0.7"
SETTINGS = PanelConfig(port=0, behind_proxy=True, names=(NAME,))
WAIT_S = 60.0


@contextmanager
def nginx(folder: Path, site: str) -> Iterator[int]:
    """Serve a site by nginx; yield its port."""
    port = free_port()
    temporary = "".join(
        f"{kind}_temp_path {folder / kind};\n"
        for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    site = site.replace("listen 443", f"listen 127.0.0.1:{port}")
    (folder / "nginx.conf").write_text(
        f"pid {folder}/pid;\nerror_log {folder}/errors;\nevents {{}}\n"
        f"http {{\naccess_log off;\n{temporary}{site}}}\n"
    )
    command = (NGINX, "-c", folder / "nginx.conf", "-g", "daemon off;")
    with subprocess.Popen(command) as process:
        try:
            ends_s = time.monotonic() + WAIT_S
            while socket.socket().connect_ex(("127.0.0.1", port)):
                assert process.poll() is None
                assert time.monotonic() < ends_s
            yield port
        finally:
            process.terminate()


def example(panel: RunningPanel) -> str:
    """The site of the README, with the files and the panel of the test."""
    text = (ROOT / "capture" / "station" / "panel" / "README.md").read_text()
    site = text.partition("```nginx\n")[2].partition("```")[0]
    for there, here in (
        ("127.0.0.1:8100", urlsplit(panel.url).netloc),
        ("/etc/ssl/line-3.crt", str(CERTIFICATE / "panel.crt")),
        ("/etc/ssl/line-3.key", str(CERTIFICATE / "panel.key")),
    ):
        assert there in site
        site = site.replace(there, here)
    return site


class Browser:
    """Asks as a browser whose page is at the name of the station."""

    def __init__(self, port: int) -> None:
        self._trusted = ssl.create_default_context(cafile=CERTIFICATE / "panel.crt")
        self._port = port
        self.headers = {"Host": f"{NAME}:{port}", "Origin": f"https://{NAME}:{port}"}

    def ask(
        self, method: str, path: str, form: dict[str, str] | None = None
    ) -> http.client.HTTPResponse:
        connection = http.client.HTTPSConnection(
            "127.0.0.1", self._port, context=self._trusted, timeout=WAIT_S,
            source_address=(CLIENT, 0),
        )  # fmt: skip
        kind = {} if form is None else {"Content-Type": "application/x-www-form-urlencoded"}
        body = None if form is None else urlencode(form)
        connection.request(method, path, body, self.headers | kind)
        return connection.getresponse()


@pytest.fixture
def panel(tmp_path: Path, captured: CapturedSet) -> Iterator[RunningPanel]:
    make_station(tmp_path / "line-3")
    Users(tmp_path / "line-3").put("ada", Role.ADMINISTRATOR, PASSWORD)
    with running_panel(tmp_path / "line-3", captured, SETTINGS) as running:
        yield running


def test_pages_changes_and_events_pass_the_proxy(panel: RunningPanel, tmp_path: Path) -> None:
    with nginx(tmp_path, example(panel)) as port:
        browser = Browser(port)
        assert browser.ask("POST", "/login", {"name": "ada", "password": "wrong"}).status == 401
        assert newest_changes(panel.bench.store, 1)[0].by == CLIENT
        login = browser.ask("POST", "/login", {"name": "ada", "password": PASSWORD})
        assert login.status == 303
        assert "Secure" in login.headers["set-cookie"]
        browser.headers["Cookie"] = login.headers["set-cookie"].partition(";")[0]
        csrf = browser.ask("GET", "/").read().decode().partition('name="csrf" content="')[2]
        panel.until_ready()
        browser.headers["X-CSRF-Token"] = csrf.partition('"')[0]
        assert browser.ask("POST", "/api/v1/trigger").status == 202
        events = browser.ask("GET", "/api/v1/events")
        assert events.status == 200
        lines = iter(events.readline, b"")
        assert b"event: snapshot\n" in lines
        # An answer that nginx collects would arrive at its end, which never comes.
        panel.live.publish(JsonEvent({"event": "filler"}))
        assert b"event: filler\n" in lines
