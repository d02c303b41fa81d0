"""Panels of running stations, with a fake rig or a simulated one, and a small HTTP client."""

import http.client
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

from capture.sets.captured_set import CapturedSet
from capture.station.domain.folder import station_folder
from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.users import Role
from capture.station.panel.guard import CSRF_FIELD
from capture.station.panel.panel import Panel
from capture.station.panel.server import serving_panel
from capture.station.run.events import JsonEvent, State
from capture.station.run.live_station import LiveStation
from capture.station.run.run import run_station
from rig import RigConfig
from tests.capture.station.stations import Bench, FakeRecipes, bench, running

ANY_PORT = PanelConfig(port=0)
PASSWORD = "correct horse"
WAIT_S = 300.0  # a panel yields to everything else that a busy machine does
JOB_S = 3600.0  # on a machine that does much else


@dataclass(frozen=True)
class Answer:
    """The answer to a request."""

    status: int
    headers: http.client.HTTPMessage
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def text(self) -> str:
        return self.body.decode()


@dataclass
class Client:
    """A client of the API, or a browser without JavaScript that keeps cookies."""

    url: str
    headers: dict[str, str] = field(default_factory=dict)
    csrf: str = ""

    @property
    def host(self) -> str:
        return urlsplit(self.url).netloc

    def ask(
        self,
        method: str,
        path: str,
        fields: dict[str, Any] | None = None,
        *,
        form: dict[str, str] | None = None,
        **headers: str,
    ) -> Answer:
        """Send a request; `fields` are sent as JSON, `form` as a form."""
        given = self.headers | {name.replace("_", "-"): value for name, value in headers.items()}
        body: bytes | None = None
        if fields is not None:
            body = json.dumps(fields).encode()
            given.setdefault("Content-Type", "application/json")
        if form is not None:
            body = urlencode(form).encode()
            given.setdefault("Content-Type", "application/x-www-form-urlencoded")
        connection = http.client.HTTPConnection(self.host, timeout=WAIT_S)
        try:
            connection.request(method, path, body, given)
            answer = connection.getresponse()
            return Answer(answer.status, answer.headers, answer.read())
        finally:
            connection.close()

    def get(self, path: str, **headers: str) -> Answer:
        return self.ask("GET", path, **headers)

    def post(self, path: str, fields: dict[str, Any] | None = None, **headers: str) -> Answer:
        return self.ask("POST", path, fields, **headers)

    def log_in(self, name: str, password: str = PASSWORD, pin: str = "") -> Answer:
        """Log in, and keep cookie and CSRF token."""
        form = {"pin": pin} if pin else {"name": name, "password": password}
        answer = self.ask("POST", "/login", form=form)
        cookie = answer.headers["set-cookie"]
        if cookie is not None:
            self.headers["Cookie"] = cookie.partition(";")[0]
            self.csrf = self.get("/").text.partition('name="csrf" content="')[2].partition('"')[0]
        return answer

    def job(self, path: str, fields: dict[str, Any] | None = None) -> Any:
        """Start a job, and return its last state."""
        answer = self.post(path, fields or {})
        assert answer.status == 202, answer.text
        ends_s = time.monotonic() + JOB_S
        while (job := self.get("/api/v1/job").json)["status"] == "running":
            assert time.monotonic() < ends_s
            time.sleep(0.1)
        return job

    def form(self, path: str, **fields: str) -> Answer:
        """Send a form of a page, with its CSRF token."""
        return self.ask("POST", path, form={CSRF_FIELD: self.csrf, **fields})


@dataclass
class ServedPanel:
    """A panel and its address."""

    panel: Panel
    url: str
    tokens: dict[Role, str] = field(default_factory=dict)

    @property
    def live(self) -> LiveStation:
        return self.panel.live

    @property
    def local(self) -> Client:
        return Client(self.url)

    def client(self, role: Role) -> Client:
        """A client with a token, called ``client-ROLE``."""
        if role not in self.tokens:
            self.tokens[role] = self.panel.tokens.add(f"client-{role}", role)
        return Client(self.url, {"Authorization": f"Bearer {self.tokens[role]}"})

    def until_ready(self) -> None:
        """Wait until the station takes a trigger."""
        assert self.live.wait_for(State.READY, WAIT_S)

    def parts(self, count: int, client: Client | None = None) -> list[str]:
        """Trigger parts by HTTP and wait for their results."""
        asking, made = client or self.local, []
        for _ in range(count):
            self.until_ready()
            answer = asking.post("/api/v1/trigger")
            assert answer.status == 202, answer.text
            part = asking.get(f"{answer.headers['location']}?wait_s=30")
            assert part.status == 200, part.text
            made.append(part.json["part_id"])
        return made


@dataclass
class RunningPanel(ServedPanel):
    """A panel and its station with a fake rig."""

    bench: Bench = field(kw_only=True)


class OwnRun(LiveStation):
    """A run in the process of its panel, which appends rows itself."""

    def append(self, *_: object) -> bool:
        return False

    def announce(self, fields: dict[str, Any]) -> None:
        self.publish(JsonEvent(fields))


@contextmanager
def running_panel(
    folder: Path,
    captured: CapturedSet,
    settings: PanelConfig = ANY_PORT,
    recipes: FakeRecipes | None = None,
) -> Iterator[RunningPanel]:
    """Run a station with a fake rig in `folder` whose triggers come by HTTP, with its panel."""
    with bench(folder, captured) as station:
        live = OwnRun(station.folder.config.name, simulated=True)
        station.live, station.recipes = live, recipes
        panel = Panel(station.folder, live, settings)
        with running(station.run), serving_panel(panel) as url:
            yield RunningPanel(panel, url, bench=station)


@contextmanager
def real_panel(folder: Path, rig_config: RigConfig) -> Iterator[ServedPanel]:
    """Run the taught station in `folder` with a simulated rig; its triggers come by HTTP."""
    with station_folder(folder) as opened:
        live = OwnRun(opened.config.name, simulated=True)
        panel = Panel(opened, live, ANY_PORT)
        with (
            live.telling(),
            running(lambda source: run_station(opened, rig_config, source, live)),
            serving_panel(panel) as url,
        ):
            yield ServedPanel(panel, url)
