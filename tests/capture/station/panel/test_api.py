"""The HTTP API over real sockets, of a station whose rig is fake."""

import hashlib
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import quote, urlsplit

import pytest
from sqlalchemy import select

from capture.sets.captured_set import CapturedSet
from capture.station.domain.fault import Fault
from capture.station.domain.users import Role
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.panel.security import Denied
from capture.station.panel.triggering import MAX_WAITING, KeyedTriggers
from capture.station.results.history import HistoryEntry
from capture.station.results.schema import overrides
from capture.station.results.store import BegunPart, ResultStore
from capture.station.run.events import JsonEvent, TriggerRefused
from capture.station.run.recovery import finish_interrupted
from capture.station.run.triggers import Accepted, Refused, Trigger, TriggerTooLate
from tests.capture.station.panel.panels import WAIT_S, RunningPanel, running_panel
from tests.capture.station.stations import PASSED, Said
from tests.memory_growth import growth_bytes
from tests.waiting import Gate, until_so

BAD = Verdict(Decision.FAIL, "a scratch of 12 px", (Cause.DEFECT,))


def test_a_trigger_is_answered_with_the_part_and_the_part_with_its_result(
    panel: RunningPanel, captured: CapturedSet, tmp_path: Path
) -> None:
    panel.until_ready()
    assert panel.local.get("/api/v1/state").json["last"] is None
    answer = panel.local.post("/api/v1/trigger", {"part_id": "A-17"})
    assert (answer.status, answer.json) == (
        202,
        {"accepted": True, "part_id": "A-17", "number": 1, "repeated": False},
    )
    part = panel.local.get("/api/v1/parts/A-17?wait_s=30")
    assert part.json["verdict"] == "PASS"
    assert part.json["trigger"] == "http"
    assert panel.bench.rows() == [("A-17", Decision.PASS)]
    counts = panel.local.get("/api/v1/counts").json
    assert [counts[kind]["parts"] for kind in ("production", "simulated")] == [0, 1]
    state = panel.local.get("/api/v1/state").json
    assert state["last"]["part_id"] == "A-17"
    assert state["announced"] == {"PASS": 1, "FAIL": 0, "UNKNOWN": 0, "ERROR": 0}
    answer = panel.local.get("/api/v1/parts/A-17/set")
    assert answer.headers["content-type"] == "image/tiff"
    (tmp_path / "set.ome.tif").write_bytes(answer.body)
    loaded = CapturedSet.load(tmp_path / "set.ome.tif")
    assert loaded.metadata.pixels_sha256 == captured.metadata.pixels_sha256
    for unknown in ("nobody", "nobody/set"):
        assert panel.local.get(f"/api/v1/parts/{unknown}").status == 404


def refused_triggers(panel: RunningPanel) -> int:
    count: int = panel.local.get("/api/v1/counts").json["simulated"]["refused_triggers"]
    return count


def test_a_trigger_whose_client_leaves_before_its_part_is_begun_is_refused(
    panel: RunningPanel,
) -> None:
    """The database holds the part up, while the client gives up."""
    store = panel.bench.store
    begin, gate = store.begin, Gate()

    def slow(*, require: Callable[[], None], **given: Any) -> BegunPart:
        def left() -> None:
            gate.hold()
            until_so(lambda: _raises(require))
            require()

        return begin(require=left, **given)

    store.begin = slow  # type: ignore[method-assign]
    panel.until_ready()
    where = urlsplit(panel.url)
    with socket.create_connection((str(where.hostname), where.port)) as client:
        client.sendall(f"POST /api/v1/trigger HTTP/1.1\r\nHost: {where.netloc}\r\n\r\n".encode())
        gate.until_reached()
    gate.open()
    until_so(lambda: refused_triggers(panel) == 1)
    assert panel.bench.rows() == []
    [event] = panel.bench.of(TriggerRefused)
    assert event.reason == "its client is gone"


def _raises(require: Callable[[], None]) -> bool:
    try:
        require()
    except TriggerTooLate:
        return True
    return False


def test_a_repeated_key_triggers_no_second_part(panel: RunningPanel) -> None:
    panel.until_ready()
    answers = []

    def trigger() -> None:
        answers.append(panel.local.post("/api/v1/trigger", Idempotency_Key="order 7"))

    threads = [threading.Thread(target=trigger) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(answer.status for answer in answers) == [200, 200, 200, 200, 200, 202]
    assert {answer.json["part_id"] for answer in answers} == {answers[0].json["part_id"]}
    assert [answer.json["repeated"] for answer in answers].count(False) == 1
    assert panel.local.get(f"{answers[0].headers['location']}?wait_s=30").json["number"] == 1
    assert len(panel.bench.rows()) == 1


def test_a_key_is_known_after_a_restart(tmp_path: Path, captured: CapturedSet) -> None:
    answers = []
    for fields in ({}, {}, {"part_id": "A-2"}):
        with running_panel(tmp_path / "line-1", captured) as panel:
            panel.until_ready()
            answer = panel.local.post("/api/v1/trigger", fields, Idempotency_Key="order 7")
            if answer.status != 422:
                panel.local.get(f"{answer.headers['location']}?wait_s=30")
            answers.append(answer)
            assert len(panel.bench.rows()) == 1
    assert [answer.status for answer in answers] == [202, 200, 422]
    assert answers[0].json | {"repeated": True} == answers[1].json


def test_a_key_with_a_recipe_is_known_after_its_part_was_interrupted(panel: RunningPanel) -> None:
    """The result of such a part names no recipe."""
    panel.until_ready()
    store, utc = panel.bench.store, "2026-05-04T13:05:00.000Z"
    part_id = f"key-{hashlib.sha256(b'order 7').hexdigest()[:20]}"
    store.begin(trigger="http", triggered_utc=utc, simulated=True, part_id=part_id)
    assert len(list(finish_interrupted(panel.bench.folder.path, store, lambda: utc))) == 1
    again = panel.local.post("/api/v1/trigger", {"recipe": "example"}, Idempotency_Key="order 7")
    assert (again.status, again.json.get("part_id")) == (200, part_id), again.json


@pytest.mark.parametrize(("first", "second"), [("A-1", "A-2"), ("A-1", None), (None, "A-2")])
def test_a_key_with_another_part_is_refused(
    panel: RunningPanel, first: str | None, second: str | None
) -> None:
    panel.until_ready()
    given, other = ({} if each is None else {"part_id": each} for each in (first, second))
    accepted = panel.local.post("/api/v1/trigger", given, Idempotency_Key="order 7")
    refused = panel.local.post("/api/v1/trigger", other, Idempotency_Key="order 7")
    assert (accepted.status, refused.status) == (202, 422)
    assert f"was accepted for part {accepted.json['part_id']}" in refused.json["error"]
    again = panel.local.post("/api/v1/trigger", given, Idempotency_Key="order 7")
    assert (again.status, again.json["repeated"]) == (200, True)
    panel.local.get(f"{again.headers['location']}?wait_s=30")
    assert len(panel.bench.rows()) == 1


def test_a_key_that_was_refused_may_be_sent_again(panel: RunningPanel) -> None:
    assert isinstance(panel.panel.triggers.submit("order 8", Trigger("http", "part-1")), Refused)
    panel.until_ready()
    panel.parts(1)
    panel.until_ready()
    assert panel.local.post("/api/v1/trigger", Idempotency_Key="order 8").status == 202


def test_the_number_of_known_keys_is_bounded() -> None:
    live = SimpleNamespace(submit=lambda trigger: Accepted(trigger.part_id, 1))
    triggers = KeyedTriggers(
        live, SimpleNamespace(store=SimpleNamespace(known_ids=lambda _: set()))
    )

    def submit(first: int, last: int) -> None:
        for number in range(first, last):
            assert isinstance(triggers.submit(f"order {number:06d}", Trigger("http")), Accepted)

    assert growth_bytes(submit, 0, 1_100, 4_400) < 50_000


def test_few_triggers_wait_for_a_station_that_does_not_answer() -> None:
    answering, asked = threading.Event(), threading.Semaphore(0)

    def submit(_: Trigger) -> Refused:
        asked.release()
        assert answering.wait(60)
        return Refused("busy")

    triggers = KeyedTriggers(SimpleNamespace(submit=submit), SimpleNamespace())
    with ThreadPoolExecutor(MAX_WAITING) as clients:
        for _ in range(MAX_WAITING):
            clients.submit(triggers.submit, None, Trigger("http"))
            assert asked.acquire(timeout=60)
        with pytest.raises(Denied):
            triggers.submit(None, Trigger("http"))
        answering.set()


@pytest.mark.parametrize(
    "query",
    [
        "verdict=MAYBE", "since=yesterday", "limit=0", "limit=501", "limit=٣", "limit=5.5",
        "below=9" + 20 * "9", "simulated=yes", "verdct=FAIL", "verdict=FAIL&verdict=PASS",
    ],
)  # fmt: skip
def test_a_query_that_is_wrong_is_named(without_users: RunningPanel, query: str) -> None:
    without_users.until_ready()  # there are results
    answer = without_users.local.get(f"/api/v1/parts?{quote(query, safe='=&')}")
    assert answer.status == 400
    assert query.partition("=")[0] in answer.json["error"]


def test_a_field_that_is_not_known_is_named_and_nothing_is_done(panel: RunningPanel) -> None:
    panel.until_ready()
    answer = panel.local.post("/api/v1/trigger", {"part": "A-17"})
    assert answer.status == 400
    assert answer.json["error"].startswith("part: ")
    assert panel.bench.rows() == []


def test_an_engineer_overrides_and_the_log_says_who_from_and_to(panel: RunningPanel) -> None:
    panel.bench.inspector.inspect = lambda _: Said(BAD)
    (part_id,) = panel.parts(1)
    engineer = panel.client(Role.ENGINEER)
    override = f"/api/v1/parts/{part_id}/override"
    empty = engineer.post(override, {"decision": "PASS", "reason": " "})
    assert (empty.status, empty.json["error"].partition(":")[0]) == (400, "reason")
    wrong = engineer.post(override, {"decision": "UNKNOWN", "reason": "a hair"})
    assert (wrong.status, wrong.json["error"].partition(":")[0]) == (400, "decision")
    for control in ("\n2026-01-02T03:04:05.678Z change by nobody", "\x1b[2J", "\0", "\u202e"):
        forged = engineer.post(override, {"decision": "PASS", "reason": f"a{control}hair"})
        assert forged.status == 400
    done = engineer.post(override, {"decision": "PASS", "reason": "a hair\u00a0"})
    assert (done.json["verdict"], done.json["station_verdict"]) == ("PASS", "FAIL")
    (change,) = engineer.get("/api/v1/audit").json["changes"]
    assert (change["by"], change["role"]) == ("client-engineer", "engineer")
    assert change["via"] == "API"
    assert (change["what"], change["before"], change["after"]) == (
        f"part {part_id}", "FAIL", "PASS: a hair"
    )  # fmt: skip
    assert len((panel.bench.folder.path / "station.log").read_text().splitlines()) == 1


def test_who_waits_for_a_part_asks_the_database_for_no_other_one(
    panel: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    begun, part = threading.Event(), ResultStore.part

    def counted(store: ResultStore, part_id: str) -> HistoryEntry | None:
        asked.append(part_id)
        begun.set()
        return part(store, part_id)

    panel.parts(1)
    monkeypatch.setattr(ResultStore, "part", counted)
    with ThreadPoolExecutor(1) as client:
        waiting = client.submit(panel.local.get, "/api/v1/parts/B-1?wait_s=30")
        assert begun.wait(60)
        for _ in range(20):
            panel.live.publish(JsonEvent({"event": "override", "part_id": "A-1"}))
            time.sleep(0.01)
        assert asked == ["B-1"]
        panel.until_ready()
        panel.local.post("/api/v1/trigger", {"part_id": "B-1"})
        assert waiting.result().json["verdict"] == "PASS"


def test_a_double_click_overrides_once(
    panel: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    (part_id,) = panel.parts(1)
    engineer, both = panel.client(Role.ENGINEER), threading.Barrier(2)
    record = panel.panel.results.record

    def record_at_once(*row: Any) -> None:
        with suppress(threading.BrokenBarrierError):
            both.wait(1.0)
        record(*row)

    monkeypatch.setattr(panel.panel.results, "record", record_at_once)
    given = {"decision": "FAIL", "reason": "a dent"}
    with ThreadPoolExecutor(2) as clicks:
        posts = [
            clicks.submit(engineer.post, f"/api/v1/parts/{part_id}/override", given)
            for _ in range(2)
        ]
    assert [post.result().status for post in posts] == [200, 200]
    with panel.bench.store.reading() as connection:
        assert len(connection.execute(select(overrides)).all()) == 1
    assert len(engineer.get("/api/v1/audit").json["changes"]) == 1


def test_a_change_behind_another_one_gives_its_thread_back(
    panel: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A database that does not answer would else keep all threads of the panel."""
    (part_id,) = panel.parts(1)
    monkeypatch.setattr("capture.station.panel.api.CHANGE_TIMEOUT_S", 0.05)
    engineer, given = panel.client(Role.ENGINEER), {"decision": "FAIL", "reason": "a dent"}
    with ThreadPoolExecutor(1) as click, panel.panel.changing:
        post = click.submit(engineer.post, f"/api/v1/parts/{part_id}/override", given)
        wait([post], timeout=60.0)
    assert post.result().status == 503


def test_an_operator_acknowledges_a_rejected_part_once(panel: RunningPanel) -> None:
    panel.bench.inspector.inspect = lambda _: Said(BAD)
    (part_id,) = panel.parts(1)
    for _ in range(2):
        assert panel.local.post(f"/api/v1/parts/{part_id}/acknowledge").status == 200
    assert panel.live.snapshot().rejected[0].acknowledged_by == "local"
    changes = panel.client(Role.ENGINEER).get("/api/v1/audit").json["changes"]
    assert [change["after"] for change in changes] == ["acknowledged"]
    assert panel.local.post("/api/v1/parts/nobody/acknowledge").status == 404


def test_an_operator_acknowledges_errors_in_a_row_of_which_no_part_was_begun(
    panel: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = Fault(Cause.STORAGE, "40 MB free on the disk", "disk")
    panel.until_ready()
    assert panel.local.post("/api/v1/acknowledge").status == 409
    with monkeypatch.context() as patch:
        patch.setattr("capture.station.run.cycle.disk_fault", lambda *_: full)
        ends_s = time.monotonic() + WAIT_S
        while not panel.live.state.is_stopped_by_errors:
            assert time.monotonic() < ends_s
            assert panel.local.post("/api/v1/trigger").status == 409
    assert panel.live.state.rejected == ()
    assert panel.local.post("/api/v1/acknowledge").status == 200
    assert panel.local.post("/api/v1/acknowledge").status == 409  # a second click
    panel.until_ready()
    assert panel.parts(1)
    [change] = panel.client(Role.ENGINEER).get("/api/v1/audit").json["changes"]
    assert (change["what"], change["after"]) == ("station line-1", "acknowledged")
    assert change["before"].startswith("40 MB free on the disk; 5 errors in a row")


def test_metrics_are_those_of_the_run(panel: RunningPanel) -> None:
    verdicts = iter([PASSED, BAD])
    panel.bench.inspector.inspect = lambda _: Said(next(verdicts))
    panel.parts(2)
    panel.until_ready()
    answer = panel.local.get("/api/v1/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    lines = answer.text.splitlines()
    for line in (
        'ps4rig_parts_total{verdict="PASS"} 1',
        'ps4rig_parts_total{verdict="FAIL"} 1',
        'ps4rig_state{state="ready"} 1',
        'ps4rig_device_fault{device="disk"} 0',
        "ps4rig_latency_seconds_count 2",
        "ps4rig_simulated 1",
    ):
        assert line in lines
    families = {line.split()[2] for line in lines if line.startswith("# TYPE")}
    named = {line.split("{")[0].split()[0] for line in lines if not line.startswith("#")}
    assert {name.removesuffix("_sum").removesuffix("_count") for name in named} == families


def test_a_method_that_is_not_known_is_answered_with_those_that_are(
    without_users: RunningPanel,
) -> None:
    allowed = {"/api/v1/job": "DELETE, GET", "/recipes/x/parts": "GET, POST", "/logout": "POST"}
    for path, methods in allowed.items():
        answer = without_users.local.ask("PUT", path)
        assert (answer.status, answer.headers["allow"]) == (405, methods)


def test_the_head_of_an_answer_can_be_asked_for(without_users: RunningPanel) -> None:
    for path in ("/", "/api/v1/state", "/static/panel.css"):
        answer = without_users.local.ask("HEAD", path)
        assert (answer.status, answer.body) == (200, b"")
        assert int(answer.headers["content-length"]) > 0
