"""`LiveStation`, its subscriptions, and the stream of events over a real socket."""

import http.client
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.fault import Fault, fault_of
from capture.station.domain.users import Identity, Role
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.database import ResultsUnavailable
from capture.station.results.part_result import PartResult
from capture.station.run.events import (
    Change,
    Device,
    JsonEvent,
    PartAnnounced,
    PartBegun,
    SelfTestFinished,
    State,
    TriggerRefused,
    Warned,
)
from capture.station.run.live_station import LiveStation
from capture.station.run.live_view import MAX_WAITING
from capture.station.run.self_test import SelfTestFailed
from capture.station.run.triggers import Refusal, Trigger
from rig.doctor.check import Check
from rig.errors import CameraError, HardwareError, LightControllerError
from tests.capture.station.panel.panels import PASSWORD, Client, RunningPanel, running_panel
from tests.capture.station.stations import PASSED, Said
from tests.waiting import Gate

UTC = "2026-01-02T03:04:05.678Z"


def result(number: int, verdict: Verdict = PASSED) -> PartResult:
    part_id = f"part-{number:06d}"
    return PartResult(
        "line-1", part_id, number, "http", UTC, UTC, UTC, verdict, None, True, "0.1.0"
    )


def error(cause: Cause) -> Verdict:
    return Verdict(Decision.ERROR, f"it failed: {cause}", (cause,))


def statuses(live: LiveStation) -> dict[str, str]:
    return {device.name: device.status for device in live.snapshot().devices}


def live_station() -> LiveStation:
    return LiveStation("line-1", simulated=True)


@contextmanager
def stream(client: Client, last: str | None = None) -> Iterator[Iterator[dict[str, Any]]]:
    """The events of a stream; each has its ``id``."""
    connection = http.client.HTTPConnection(client.host, timeout=30)
    headers = client.headers | ({} if last is None else {"Last-Event-ID": last})
    connection.request("GET", "/api/v1/events", headers=headers)
    answer = connection.getresponse()
    assert answer.status == 200
    assert answer.headers["content-type"] == "text/event-stream; charset=utf-8"

    def messages() -> Iterator[dict[str, Any]]:
        fields: dict[str, str] = {}
        for line in answer:
            name, _, value = line.decode().rstrip("\n").partition(": ")
            if name:
                fields[name] = value
            elif "data" in fields:
                message = json.loads(fields["data"])
                assert message["event"] == fields["event"]
                yield {"id": fields["id"], **message}
                fields = {}

    try:
        yield messages()
    finally:
        connection.close()


def test_the_stream_begins_with_the_state_and_goes_on_with_each_event(panel: RunningPanel) -> None:
    panel.bench.inspector.inspect = lambda _: Said(error(Cause.CAPTURE))
    panel.until_ready()
    with stream(panel.local) as messages:
        first = next(messages)
        assert (first["event"], first["state"]) == ("snapshot", "ready")
        (part_id,) = panel.parts(1)
        kinds = []
        for message in messages:
            kinds.append(message["event"])
            if message["event"] == "part":
                assert message["part_id"] == part_id
                assert (message["decision"], message["causes"]) == ("ERROR", ["capture"])
                assert message["reason"] == "it failed: capture"
                assert message["latency_ms"] > 0.0
                break
        assert [kind for kind in kinds if kind != "state"] == ["begun", "exposed", "part"]


def test_a_stream_that_was_cut_off_goes_on_where_it_was(panel: RunningPanel) -> None:
    panel.until_ready()
    with stream(panel.local) as messages:
        last = next(messages)["id"]
    panel.parts(3)
    panel.until_ready()
    with stream(panel.local, last) as messages:
        seen: list[dict[str, Any]] = []
        while sum(each["event"] == "part" for each in seen) < 3:
            seen.append(next(messages))
    numbers = [int(each["id"].partition(".")[2]) for each in seen]
    begin = int(last.partition(".")[2]) + 1
    assert numbers == list(range(begin, begin + len(numbers)))
    for unknown in ("", "x", "00000000.1", f"{last}9", f"{last.partition('.')[0]}.-1"):
        with stream(panel.local, unknown) as messages:
            assert next(messages)["event"] == "snapshot"


@pytest.mark.parametrize("is_busy", [False, True])
def test_a_stream_ends_when_its_user_is_removed(
    panel: RunningPanel, monkeypatch: Any, is_busy: bool
) -> None:
    monkeypatch.setattr("capture.station.panel.event_stream.KEEP_ALIVE_S", 0.2)
    panel.panel.users.put("root", Role.ADMINISTRATOR, PASSWORD)
    client, is_over = panel.client(Role.OPERATOR), threading.Event()

    def announce() -> None:
        while is_busy and not is_over.wait(0.01):
            panel.live.publish(JsonEvent({"event": "override"}))

    threading.Thread(target=announce, daemon=True).start()
    try:
        with stream(client) as messages:
            next(messages)
            panel.panel.tokens.remove("client-operator")
            until_s = time.monotonic() + 60.0
            assert all(time.monotonic() < until_s for _ in messages)  # ends by itself
    finally:
        is_over.set()


def test_events_do_not_wait_for_the_check_of_a_user(panel: RunningPanel, monkeypatch: Any) -> None:
    gate = Gate()

    def identity(*_: object) -> Identity:
        gate.hold()
        return Identity("kim", Role.OPERATOR, "local")

    monkeypatch.setattr("capture.station.panel.event_stream.identity_of", identity)
    monkeypatch.setattr("capture.station.panel.event_stream.KEEP_ALIVE_S", 0.05)
    try:
        with stream(panel.local) as messages:
            next(messages)
            gate.until_reached()
            panel.live.publish(JsonEvent({"event": "override"}))
            assert any(each["event"] == "override" for each in messages)
    finally:
        gate.open()


def test_a_stream_ends_with_the_last_event(panel: RunningPanel) -> None:
    panel.until_ready()
    with stream(panel.local) as messages:
        next(messages)
        panel.live.publish(JsonEvent({"event": "stopped"}))
        panel.live.close()
        assert [each["event"] for each in messages][-1] == "stopped"


def test_the_end_of_the_run_ends_streams_and_the_server(
    tmp_path: Path, captured: CapturedSet
) -> None:
    ended = threading.Event()
    with running_panel(tmp_path / "line-1", captured) as panel:

        def listen() -> None:
            with stream(panel.local) as followed:
                opened.set()
                assert list(followed)
            ended.set()

        opened = threading.Event()
        threading.Thread(target=listen, daemon=True).start()
        assert opened.wait(30)
    assert ended.wait(30)


def test_a_subscriber_that_takes_nothing_loses_events_and_learns_how_many() -> None:
    live = live_station()
    subscription = live.subscribe()
    for number in range(MAX_WAITING + 10):
        live.publish(JsonEvent({"event": "filler", "number": number}))
    events, lost = subscription.take()
    assert (len(events), lost) == (10, MAX_WAITING)
    assert events[-1].fields["number"] == MAX_WAITING + 9
    assert subscription.take() == ([], 0)


def test_the_history_of_events_is_bounded_and_says_what_it_has_lost() -> None:
    live = live_station()
    for number in range(2000):
        live.publish(JsonEvent({"event": "filler", "number": number}))
    last = live.snapshot().event_id
    kept = live.events_after(last - 5)
    assert kept is not None
    assert [event.id for event in kept] == list(range(last - 4, last + 1))
    assert live.events_after(0) is None
    assert live.events_after(last) == []
    assert live.events_after(last + 1) is None


def test_a_closed_station_ends_every_subscription() -> None:
    live = live_station()
    before, woken = live.subscribe(), []
    live.subscribe(lambda: woken.append(1))
    live.close()
    after = live.subscribe()
    assert (before.is_closed, after.is_closed, woken) == (True, True, [1])
    assert before.take() == ([], 0)


def test_the_rate_falls_when_no_part_comes() -> None:
    now_s = [0.0]
    live = LiveStation("line-1", simulated=True, now_s=lambda: now_s[0])
    for number in range(1, 12):
        now_s[0] = float(number)
        live.publish(PartAnnounced(result(number), 10.0))
    assert live.snapshot().parts_per_minute == 60.0
    now_s[0] = 31.0
    assert live.snapshot().parts_per_minute == 20.0
    now_s[0] = 200.0
    assert live.snapshot().parts_per_minute == 0.0


def test_a_snapshot_says_which_part_has_no_verdict_yet() -> None:
    """A page that is opened meanwhile must not show the verdict before as that of this part."""
    live = live_station()
    seen = []
    for event in (
        PartBegun("part-000001", 1),
        PartBegun("part-000002", 2),
        PartAnnounced(result(1), 1.0),
        PartAnnounced(result(2), 1.0),
    ):
        live.publish(event)
        seen.append(live.snapshot().fields()["inspected"])
    assert seen == ["part-000001", "part-000002", "part-000002", None]


def test_rejected_parts_are_kept_the_newest_first_and_acknowledged_once() -> None:
    live = live_station()
    for number in range(1, 30):
        verdict = error(Cause.CAPTURE) if number % 2 else PASSED
        live.publish(PartAnnounced(result(number, verdict), 10.0))
    shown = live.snapshot()
    assert [each.result.number for each in shown.rejected] == list(range(29, 5, -2))
    assert shown.announced == {Decision.PASS: 14, Decision.ERROR: 15}
    resumed: list[bool] = []
    live.attach(SimpleNamespace(resume=lambda: resumed.append(True)))
    assert live.acknowledge("part-000029", "Ada")
    assert resumed == [True]
    assert live.acknowledge("part-000029", "Kim")
    assert live.snapshot().rejected[0].acknowledged_by == "Ada"
    assert not live.acknowledge("part-000001", "Ada")


def test_devices_follow_the_self_test_and_failures() -> None:
    live = live_station()
    assert set(statuses(live).values()) == {"unknown", "off"}
    checks = (
        Check("disk", "ok", "can be written", device="disk"),
        Check("results", "ok", "the database answers", device="database"),
        Check("calibration", "warning", "300 days old"),
        Check("LED 0", "ok", "20 %", device="lights"),
        Check("LED 1", "warning", "9 %: weak", device="lights"),
    )
    live.publish(SelfTestFinished(checks))
    good = {"camera": "ok", "lights": "warning", "plc": "off", "disk": "ok", "database": "ok"}
    assert statuses(live) == good
    for raised, at_fault in (
        (ResultsUnavailable("/srv/line-1/results.sqlite: locked"), {"database"}),
        (CameraError("/dev/video0: unplugged"), {"camera"}),
        (LightControllerError("/dev/ttyACM0: unplugged"), {"lights"}),
        (HardwareError("the rig is not open"), {"camera", "lights"}),
        (SelfTestFailed([Check("LED 0", "fault", "dead", device="lights")]), {"lights"}),
        (ValueError("a defect"), set()),
    ):
        fault = fault_of(raised)
        live.change(Change.FAILED, fault)
        assert live.state.fault == fault
        assert {name for name, status in statuses(live).items() if status == "fault"} == at_fault
        live.change(Change.OPENED)
        assert (live.state.fault, statuses(live) == good) == (None, not at_fault)
        live.change(Change.TESTED)  # only a self-test says that it is over
        assert statuses(live) == good
    disk = Fault(Cause.STORAGE, "3 MB free", "disk", 3.0, 50.0)
    live.publish(PartAnnounced(result(1, disk.verdict), 1.0, disk))
    live.change(Change.FAILED, disk)  # as the cycle does
    assert statuses(live) == good | {"disk": "fault"}
    live.change(Change.OPENED)
    live.change(Change.TESTED)
    live.publish(SelfTestFinished((Check("rig", "fault", "no such device", device="rig"),)))
    assert statuses(live)["camera"] == statuses(live)["lights"] == "fault"
    for _ in range(2):
        live.show_device(Device("plc", "ok", "connected"))
    assert statuses(live)["plc"] == "ok"
    kinds = [each.fields["event"] for each in live.events_after(0) or ()]
    assert kinds.count("device") == 1


def test_warnings_are_part_of_the_state() -> None:
    live = live_station()
    for number in range(20):
        live.publish(Warned(f"drift {number}"))
    assert live.state.warnings[-1] == "drift 19"
    assert live.snapshot().fields()["warnings"] == live.state.warnings
    assert len(live.state.warnings) < 20


def test_a_weak_led_is_a_fault_of_the_lights_until_a_part_shows_that_it_is_over() -> None:
    live = live_station()
    live.publish(SelfTestFinished((Check("LED 0", "ok", "20 %", device="lights"),)))
    weak = replace(result(1, error(Cause.RIG)), led_levels=(1.0, 0.6, 1.0, 1.0))
    is_weak = Fault(Cause.RIG, "weak", "lights", 0.6, 0.85)
    is_lost = Fault(Cause.RIG, "unplugged", "rig")
    good = replace(result(2), led_levels=(1.0, 1.0, 1.0, 1.0))
    live.publish(PartAnnounced(weak, 1.0, is_weak))
    assert (statuses(live)["camera"], statuses(live)["lights"]) == ("ok", "fault")
    live.publish(PartAnnounced(result(2, error(Cause.CAPTURE)), 1.0))  # nothing measured
    assert statuses(live)["lights"] == "fault"
    live.publish(PartAnnounced(good, 1.0))
    assert statuses(live)["lights"] == "ok"
    # A part that was captured before the lights were lost says nothing of them.
    live.publish(PartAnnounced(result(3, error(Cause.RIG)), 1.0, is_lost))
    live.publish(PartAnnounced(good, 1.0))
    assert (statuses(live)["camera"], statuses(live)["lights"]) == ("fault", "fault")


def test_a_trigger_before_the_station_is_there_is_refused() -> None:
    live = live_station()
    assert live.submit(Trigger("http")).kind is Refusal.NOT_READY
    assert not live.wait_for(State.READY, 0.0)
    live.publish(TriggerRefused("http", None, "busy", recorded=True))
    assert live.snapshot().refused == 1
