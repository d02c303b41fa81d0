"""The live socket between a run and its panels, and what a panel shows without a run."""

import json
import socket
import sqlite3
import struct
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from capture.station.domain.errors import CannotListen
from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.users import Identity, Role
from capture.station.domain.verdict import Cause
from capture.station.panel.panel import Panel
from capture.station.panel.server import serving_panel
from capture.station.panel.station_link import NO_RUN, RunUnavailable, StationLink
from capture.station.results import audit
from capture.station.results.database import ResultsUnavailable
from capture.station.results.part_result import require_given_part_id
from capture.station.results.store import open_store
from capture.station.run import live_socket
from capture.station.run.events import (
    Change,
    JsonEvent,
    PartAnnounced,
    PartBegun,
    RecipeLoaded,
    State,
    StateChanged,
)
from capture.station.run.live_socket import MAX_PANELS, MAX_REQUEST_BYTES, serving_live
from capture.station.run.live_station import LiveStation
from capture.station.run.live_view import MAX_WAITING, STATE, Subscription
from capture.station.run.station_state import StationState
from capture.station.run.triggers import (
    Accepted,
    Answer,
    Asker,
    RecipeRefusal,
    RecipeRefused,
    Refusal,
    Refused,
    Trigger,
)
from classify.base.errors import InputError
from tests.capture.station.panel.panels import ANY_PORT, Client
from tests.capture.station.panel.test_live import error, result
from tests.capture.station.results.parts import inspect
from tests.waiting import until_so

WAIT_S = 60.0
ADA = Asker("Ada", "engineer", "0" * 64)
LOADED = RecipeLoaded("example", 2, "1" * 64, "Ada")


class Station:
    """The side of a station that triggers see."""

    is_stopping = False

    def __init__(self, live: LiveStation) -> None:
        self.live = live
        self.asked: list[object] = []

    def submit(self, trigger: Trigger) -> Answer:
        self.asked.append(trigger)
        return Refused("busy", Refusal.BUSY) if trigger.part_id else Accepted("part-000001", 1)

    def resume(self) -> None:
        """Go on after a row of errors."""

    def load_recipe(self, name: str, by: Asker) -> RecipeLoaded:
        self.asked.append((name, by))
        if name != LOADED.name:
            raise RecipeRefused("nobody approved it", RecipeRefusal.NOT_APPROVED)
        self.live.publish(LOADED)
        return LOADED


@pytest.fixture
def folder(tmp_path: Path) -> StationFolder:
    """A station whose path is longer than the address of a socket."""
    path = tmp_path.joinpath(*["a folder of this machine"] * 5, "line-1")
    path.parent.mkdir(parents=True)
    make_station(path)
    return StationFolder(path)


@contextmanager
def running(folder: StationFolder) -> Iterator[LiveStation]:
    live = LiveStation("line-1", simulated=True)
    live.attach(Station(live))  # type: ignore[arg-type]
    with serving_live(folder, live):
        yield live


@contextmanager
def linked(folder: StationFolder) -> Iterator[StationLink]:
    link = StationLink(folder)
    try:
        yield link
    finally:
        link.close()


def same(link: StationLink, live: LiveStation) -> bool:
    def shown(snapshot: StationState) -> StationState:
        return replace(snapshot, parts_per_minute=0.0, subscribers=0)

    return shown(link.snapshot()) == shown(live.snapshot())


def test_a_panel_shows_what_the_run_shows(folder: StationFolder) -> None:
    with running(folder) as live, linked(folder) as link:
        live.publish(PartAnnounced(result(1, error(Cause.CAPTURE)), 12.0))
        until_so(lambda: same(link, live))
        subscription = link.subscribe()
        for event in (
            LOADED,
            StateChanged(State.ERROR, Change.FAILED, why="disk: 3 MB free"),
            PartBegun("part-000002", 2),
            PartAnnounced(result(2, error(Cause.STORAGE)), 30.0),
            PartBegun("part-000003", 3),
        ):
            live.publish(event)
        assert link.acknowledge("part-000001", "Ada")
        # The reply comes after the events before it.
        assert same(link, live)
        assert link.snapshot().fields()["rejected"][1]["acknowledged_by"] == "Ada"
        sent = link.events_after(1)
        assert sent is not None
        assert [event.as_json for event in sent] == [
            event.as_json for event in live.events_after(1) or ()
        ]
        assert subscription.take()[0] == sent


def test_requests_of_a_panel_have_the_answers_of_the_station(folder: StationFolder) -> None:
    with running(folder) as live, linked(folder) as link:
        until_so(lambda: same(link, live))
        assert link.submit(Trigger("http")) == Accepted("part-000001", 1)
        assert link.submit(Trigger("http", "A-1")) == Refused("busy", Refusal.BUSY)
        assert link.load_recipe("example", ADA) == LOADED
        assert link.snapshot().recipe == LOADED
        with pytest.raises(RecipeRefused, match="nobody approved it") as refused:
            link.load_recipe("other", ADA)
        assert refused.value.kind is RecipeRefusal.NOT_APPROVED
        assert not link.acknowledge("part-000009", "Ada")
        target = live._target
        assert isinstance(target, Station)
        assert target.asked == [
            Trigger("http"), Trigger("http", "A-1"), ("example", ADA), ("other", ADA),
        ]  # fmt: skip
        link.announce({"event": "override", "part_id": "part-000001"})
        assert (live.events_after(live.snapshot().event_id - 1) or ())[0].fields == {
            "event": "override", "part_id": "part-000001",
        }  # fmt: skip


def test_the_run_hears_of_the_age_of_a_trigger_and_of_a_client_that_leaves(
    folder: StationFolder,
) -> None:
    has_left = threading.Event()
    with running(folder) as live, linked(folder) as link:
        until_so(lambda: same(link, live))
        heard: list[Trigger] = []

        def until_withdrawn(trigger: Trigger) -> Answer:
            heard.append(trigger)
            assert not trigger.is_withdrawn()
            has_left.set()
            until_so(trigger.is_withdrawn)
            return Refused("its client is gone", Refusal.LATE)

        live._target.submit = until_withdrawn  # type: ignore[union-attr,method-assign]
        asked = Trigger("http", is_withdrawn=has_left.is_set)
        assert link.submit(asked) == Refused("its client is gone", Refusal.LATE)
        assert heard[0].at_s == asked.at_s


@pytest.mark.parametrize("part_id", ["\ud800", "A\n", "\N{CJK UNIFIED IDEOGRAPH-4E00}" * 21_000])
def test_a_trigger_with_an_id_that_is_none_leaves_the_panel_connected(
    folder: StationFolder, part_id: str
) -> None:
    with linked(folder) as link, running(folder) as live:
        until_so(lambda: link.state.run == live.state.run)
        with serving_panel(Panel(folder, link, ANY_PORT)) as url:
            body = json.dumps({"part_id": part_id}, ensure_ascii=len(part_id) == 1)
            headers = {"Content-Type": "application/json"}
            request = urllib.request.Request(f"{url}api/v1/trigger", body.encode(), headers)
            with pytest.raises(urllib.error.HTTPError, match="409"):
                urllib.request.urlopen(request, timeout=WAIT_S)
            [asked] = live._target.asked  # type: ignore[union-attr]
            with pytest.raises(InputError, match="give 1 to 100 letters"):
                require_given_part_id(asked.part_id)


def test_a_panel_without_a_run_says_so_and_follows_the_next_one(folder: StationFolder) -> None:
    with linked(folder) as link:
        panel = Panel(folder, link, ANY_PORT)
        with serving_panel(panel) as url:
            client = Client(url)

            def state() -> dict[str, object]:
                return dict(client.get("/api/v1/state").json)

            assert (state()["state"], state()["reason"]) == ("preoperational", NO_RUN)
            answer = client.post("/api/v1/trigger")
            assert (answer.status, answer.json["error"]) == (503, NO_RUN)
            assert client.get("/recipes").status == 200
            link.announce({"event": "override"})  # nobody hears of it
            runs = []
            for _ in range(2):
                with running(folder) as live:
                    live.publish(PartAnnounced(result(1, error(Cause.CAPTURE)), 12.0))
                    live.publish(StateChanged(State.READY, Change.TESTED, why="self-test passed"))
                    until_so(lambda: state()["state"] == "ready")
                    assert client.post("/api/v1/trigger").status == 202
                    runs.append(state()["run"])
                until_so(lambda: state()["reason"] == NO_RUN)
                assert state()["rejected"] == []
            assert len({*runs}) == 2


def test_who_sees_the_state_of_a_run_may_send_a_request(folder: StationFolder) -> None:
    live, answers = LiveStation("line-1", simulated=True), list[Answer | RunUnavailable]()
    station = Station(live)
    live.attach(station)  # type: ignore[arg-type]

    def ask() -> None:
        try:
            answers.append(link.submit(Trigger("http")))
        except RunUnavailable as error:
            answers.append(error)

    asking = threading.Thread(target=ask)

    def wake() -> None:
        if link.state.run == live.state.run and not asking.ident:
            asking.start()
            until_so(lambda: bool(answers or station.asked))

    with linked(folder) as link:
        link.subscribe(wake)
        with serving_live(folder, live):
            until_so(lambda: asking.ident is not None)
            asking.join(WAIT_S)
    assert answers == [Accepted("part-000001", 1)]


def test_a_link_that_is_closed_before_it_has_the_state_hangs_up(folder: StationFolder) -> None:
    state = StationState("line-1", simulated=True, trigger="http")
    with (
        live_socket.live_address(folder.path) as address,
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as run,
    ):
        run.bind(address)
        run.listen()
        link = StationLink(folder)
        closing = threading.Thread(target=link.close)
        with run.accept()[0] as connection:
            connection.settimeout(WAIT_S)
            closing.start()
            until_so(link._ending.is_set)
            connection.sendall(b'{"snapshot":%s}\n' % STATE.dump_json(state))
            assert connection.recv(1) == b""
        closing.join()


def test_a_request_whose_run_ends_is_answered(folder: StationFolder) -> None:
    with linked(folder) as link:
        with running(folder) as live:
            until_so(lambda: same(link, live))
            begun = threading.Event()

            def never(_: Trigger) -> Answer:
                begun.set()
                until_so(lambda: live._is_closed)
                time.sleep(0.1)
                raise OSError("the rig is gone")

            live._target.submit = never  # type: ignore[union-attr,method-assign]
            failed: list[Exception] = []

            def ask() -> None:
                try:
                    link.submit(Trigger("http"))
                except RunUnavailable as raised:
                    failed.append(raised)

            asking = threading.Thread(target=ask)
            asking.start()
            assert begun.wait(WAIT_S)
        asking.join(WAIT_S)
        assert len(failed) == 1


@contextmanager
def connected(folder: StationFolder) -> Iterator[socket.socket]:
    with (
        live_socket.live_address(folder.path) as address,
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection,
    ):
        connection.settimeout(WAIT_S)
        connection.connect(address)
        yield connection


def test_the_run_writes_the_changes_of_its_panel(
    folder: StationFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A panel that a debugger stops in mid-write would hold the lock that results wait for."""
    monkeypatch.setattr(audit, "CHANGE_TIMEOUT_S", 0.1)
    kim = Identity("kim", Role.ENGINEER, "page")
    with open_store(folder.results, folder.config.name, create=True) as store:
        inspect(store)
        with linked(folder) as link:
            access = audit.ResultsAccess(folder, link.append)
            with running(folder), monkeypatch.context() as patch, closing(access):
                until_so(lambda: link.state.run != "")
                patch.setattr(access.store, "append_rows", None)
                access.record(kim, "user lee", None, "operator")
                entry = store.part("part-000001")
                assert entry is not None
                about = {"decision": "FAIL", "by": "kim", "reason": "a hair"}
                access.override(kim, entry, **about)
                with closing(sqlite3.connect(folder.results, isolation_level=None)) as other:
                    other.execute("BEGIN IMMEDIATE")
                    with pytest.raises(ResultsUnavailable, match=r"nothing was changed.*locked"):
                        access.record(kim, "user lee", "operator", None)
            until_so(lambda: link.state.reason == NO_RUN)
            access.record(kim, "user lee", "operator", None)
        overridden = store.part("part-000001")
        assert overridden is not None
        assert overridden.decision == "FAIL"
        assert [change.what for change in audit.newest_changes(store, 9)] == [
            "user lee", "part part-000001", "user lee",
        ]  # fmt: skip


def test_only_the_user_of_the_run_may_follow_it(
    folder: StationFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(folder) as live:
        assert (folder.path / live_socket.NAME).stat().st_mode & 0o777 == 0o600
        own = live_socket.os.geteuid()
        monkeypatch.setattr(live_socket.os, "geteuid", lambda: own + 1)
        with connected(folder) as connection:
            assert connection.recv(1) == b""
        assert live.snapshot().subscribers == 0


def send_much(live: LiveStation, link: StationLink) -> None:
    for number in range(5 * MAX_WAITING):
        live.publish(JsonEvent({"event": "filler", "number": number, "text": "x" * 2000}))
        if number % 50 == 0:  # a station makes no hundred parts at once
            until_so(lambda: same(link, live))


def test_a_panel_that_reads_nothing_delays_nobody(
    folder: StationFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_socket, "SEND_TIME", struct.pack("ll", 300, 0))
    with running(folder) as live, connected(folder), linked(folder) as link:
        until_so(lambda: live.snapshot().subscribers == 2 and same(link, live))
        send_much(live, link)
        assert live.snapshot().subscribers == 2  # it is still waited for


def test_a_panel_that_reads_nothing_is_cut(
    folder: StationFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_socket, "SEND_TIME", struct.pack("ll", 0, 200_000))
    with running(folder) as live, connected(folder) as stopped, linked(folder) as link:
        until_so(lambda: live.snapshot().subscribers == 2 and same(link, live))
        send_much(live, link)
        until_so(lambda: live.snapshot().subscribers == 1)
        with stopped.makefile("rb") as lines:
            assert len(list(lines)) < 5 * MAX_WAITING
        with connected(folder) as again, again.makefile("rb") as lines:
            assert json.loads(lines.readline())["snapshot"]["event_id"] == 5 * MAX_WAITING


def test_a_panel_that_leaves_while_the_run_looks_for_its_own_end_is_let_go(
    folder: StationFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_closed = Subscription.is_closed.fget
    assert is_closed is not None

    def left_meanwhile(subscription: Subscription) -> bool:
        was_closed = bool(is_closed(subscription))
        if not left:
            left.append(subscription)
            connection.shutdown(socket.SHUT_WR)
            until_so(
                lambda: "live requests" not in {thread.name for thread in threading.enumerate()}
            )
        return was_closed

    left: list[Subscription] = []
    monkeypatch.setattr(Subscription, "is_closed", property(left_meanwhile))
    with running(folder) as live, connected(folder) as connection:
        until_so(lambda: live.snapshot().subscribers == 1)
        live.publish(JsonEvent({"event": "filler"}))
        with connection.makefile("rb") as lines:
            assert list(lines)  # to the end


def test_panels_and_lines_are_bounded(folder: StationFolder) -> None:
    with running(folder) as live, connected(folder) as first:
        until_so(lambda: live.snapshot().subscribers == 1)
        first.sendall(b"x" * (2 * MAX_REQUEST_BYTES))
        until_so(lambda: live.snapshot().subscribers == 0)
        for line in (b"{}\n", b'{"id": 1, "call": "stop", "arguments": []}\n', b"\xff\n"):
            with connected(folder) as connection:
                until_so(lambda: live.snapshot().subscribers == 1)
                connection.sendall(line)
                until_so(lambda: live.snapshot().subscribers == 0)
        links = [StationLink(folder) for _ in range(MAX_PANELS)]
        until_so(lambda: live.snapshot().subscribers == MAX_PANELS)
        with connected(folder) as connection:
            assert connection.recv(1) == b""
        for link in links:
            link.close()


def test_a_socket_of_a_killed_run_is_replaced_and_a_folder_that_takes_none_is_named(
    folder: StationFolder,
) -> None:
    with socket.socket(socket.AF_UNIX) as left, live_socket.live_address(folder.path) as address:
        left.bind(address)
    with running(folder):
        pass
    assert not (folder.path / live_socket.NAME).exists()
    (folder.path / live_socket.NAME).mkdir()
    with pytest.raises(CannotListen, match=r"live\.sock"), running(folder):
        pass
