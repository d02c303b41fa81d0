"""The cycle: order, overlap, commit order, refusals, and no way from an exception to PASS."""

import shutil
import sqlite3
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NoReturn

import pytest

from capture.base.errors import CalibrationError, SetRejected
from capture.sets.captured_set import CapturedSet
from capture.station.domain.verdict import Cause, Decision
from capture.station.results.part_result import PartResult
from capture.station.run.cycle import Station
from capture.station.run.events import (
    ExposureComplete,
    PartAnnounced,
    PartRecovered,
    State,
    StateChanged,
    StationStopped,
    TriggerRefused,
)
from capture.station.run.live_view import LiveEvent
from capture.station.run.self_test import SelfTestFailed, check_disk
from capture.station.run.station_clock import StationClock
from capture.station.run.triggers import (
    Accepted,
    Answer,
    Refusal,
    Refused,
    Trigger,
)
from classify.base.durable_file import durable_file
from classify.base.errors import InputError
from rig import CameraError, HardwareError
from rig.doctor.check import Check
from tests.capture.station.stations import (
    PASSED,
    Bench,
    Manual,
    Said,
    bench,
    one_after_the_other,
    until_ready,
)
from tests.waiting import Gate


@pytest.fixture
def station(tmp_path: Path, captured: CapturedSet) -> Iterator[Bench]:
    with bench(tmp_path / "line-1", captured) as made:
        yield made


def trigger(station: Station, part_id: str | None = None) -> Answer:
    return station.submit(Trigger("timer", part_id))


def ids(*numbers: int) -> list[str]:
    return [f"part-{number:06d}" for number in numbers]


# order, overlap, commit order


def test_parts_are_announced_in_the_order_of_their_triggers(station: Bench) -> None:
    station.run(one_after_the_other(5), count=5)
    assert station.announced() == [(each, Decision.PASS) for each in ids(1, 2, 3, 4, 5)]
    assert station.rows() == station.announced()
    results = [event.result for event in station.of(PartAnnounced)]
    assert all((station.folder.path / result.set_file).is_file() for result in results)
    assert all(result.operator == "Ada" and result.simulated for result in results)
    assert station.of(StationStopped)[-1].parts == {Decision.PASS: 5}


def test_the_next_part_is_exposed_while_the_last_verdict_is_computed(station: Bench) -> None:
    gate = Gate()
    station.inspector.inspect = lambda _: gate.hold() or Said(PASSED)
    station.camera.on_capture = lambda number: gate.open() if number == 2 else None
    station.run(one_after_the_other(2), count=2)
    kinds = [type(e) for e in station.events if isinstance(e, ExposureComplete | PartAnnounced)]
    assert kinds.count(PartAnnounced) == 2
    assert kinds[0] is ExposureComplete
    assert station.announced() == [(each, Decision.PASS) for each in ids(1, 2)]


def test_a_part_is_announced_only_with_its_file_and_its_row_on_disk(station: Bench) -> None:
    steps: list[str] = []
    add, save = station.store.add, station.save

    def saved(captured: CapturedSet, path: Path) -> None:
        time.sleep(0.05)
        save(captured, path)
        steps.append("file")

    def added(result: Any) -> Any:
        assert (station.folder.path / result.set_file).is_file()
        steps.append("row")
        return add(result)

    station.save, station.store.add = saved, added  # type: ignore[method-assign]

    def listen(live: LiveEvent) -> None:
        if isinstance(live.event, PartAnnounced):
            steps.append("announced")

    station.listen = listen
    station.run(one_after_the_other(1), count=1)
    assert steps == ["file", "row", "announced"]


# refusals


def test_a_trigger_during_an_exposure_is_refused_and_recorded(station: Bench) -> None:
    gate = Gate()

    def feed(target: Station) -> None:
        until_ready(target)
        assert isinstance(trigger(target), Accepted)
        gate.until_reached()
        answer = trigger(target)
        gate.open()
        assert isinstance(answer, Refused)
        assert answer.kind is Refusal.BUSY
        until_ready(target)

    station.camera.on_capture = gate.hold
    station.run(Manual(feed))
    assert [event.recorded for event in station.of(TriggerRefused)] == [True]
    assert station.store.counters().simulated.refused_triggers == 1
    assert station.announced() == [(*ids(1), Decision.PASS)]


def test_a_trigger_is_refused_while_all_buffers_wait_for_verdicts(station: Bench) -> None:
    gate = Gate()

    def feed(target: Station) -> None:
        for _ in range(2):
            until_ready(target)
            assert isinstance(trigger(target), Accepted)
        while "2 parts wait for their verdict" not in getattr(trigger(target), "reason", ""):
            time.sleep(0.01)
        assert not target.wait_until_ready(0.05)
        gate.open()
        until_ready(target)

    station.inspector.inspect = lambda _: gate.hold() or Said(PASSED)
    station.run(Manual(feed), buffers=2)
    assert len(station.announced()) == 2
    assert station.store.counters().simulated.refused_triggers == len(station.of(TriggerRefused))


def test_a_part_that_is_accepted_just_before_the_stop_gets_its_verdict(
    station: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread that captures asks whether to end while other threads trigger and stop."""
    ready, has_asked = list[Station](), threading.Event()

    def is_stopping(cycle: Station) -> bool:
        is_capture = threading.current_thread().name == "station capture"
        # Stations of other tests may run in this process.
        if is_capture and cycle in ready and not has_asked.is_set():
            has_asked.set()
            assert isinstance(trigger(cycle), Accepted)
            cycle.stop()
        return cycle._stopping.is_set()

    def feed(target: Station) -> None:
        until_ready(target)
        ready.append(target)
        assert has_asked.wait(60.0)

    monkeypatch.setattr(Station, "is_stopping", property(is_stopping))
    station.run(Manual(feed))
    assert [part_id for part_id, _ in station.announced()] == ["part-000001"]
    assert station.store.unfinished() == []


def test_no_backup_sees_the_file_of_the_self_test(
    station: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A backup leaves out hidden files. Any other that is removed meanwhile would end it."""
    written: list[str] = []

    def noted(path: Path) -> Any:
        written.append(path.name)
        return durable_file(path)

    monkeypatch.setattr("capture.station.run.self_test.durable_file", noted)
    assert [each.status for each in check_disk(station.folder.path, 1, 9)] == ["ok"]
    assert [name[0] for name in written] == ["."]


def test_a_folder_that_cannot_be_written_keeps_the_station_from_ready(station: Bench) -> None:
    parts = station.folder.path / "parts"
    station.prepare = lambda: list(check_disk(station.folder.path, 1, 9))

    def feed(target: Station) -> None:
        until_ready(target)
        trigger(target)
        while not station.announced():
            time.sleep(0.01)
        until_ready(target)
        shutil.rmtree(parts)
        parts.write_text("a file in its place")
        trigger(target)
        while "cannot be" not in getattr(trigger(target), "reason", ""):
            time.sleep(0.01)
        parts.unlink()
        until_ready(target)
        trigger(target)

    station.run(Manual(feed))
    decisions = [decision for _, decision in station.announced()]
    # Until the first of them fails, parts are accepted.
    assert (decisions[0], decisions[-1]) == (Decision.PASS, Decision.PASS)
    assert len(decisions) > 2
    for announced in station.of(PartAnnounced)[1:-1]:
        assert announced.result.verdict.causes == (Cause.STORAGE,)


def test_a_part_id_is_taken_once(station: Bench) -> None:
    answers: list[Answer] = []

    def feed(target: Station) -> None:
        for part_id in ("A-7", "A-7", "../etc", "A-8"):
            until_ready(target)
            answers.append(trigger(target, part_id))

    station.run(Manual(feed))
    assert [isinstance(answer, Accepted) for answer in answers] == [True, False, False, True]
    assert [part_id for part_id, _ in station.announced()] == ["A-7", "A-8"]


def test_below_the_disk_floor_triggers_are_refused(station: Bench) -> None:
    def feed(target: Station) -> None:
        until_ready(target)
        answer = trigger(target)
        assert isinstance(answer, Refused)
        assert answer.kind is Refusal.DISK

    station.run(Manual(feed), disk_floor_mb=10_000_000)
    assert station.announced() == []
    assert [event.recorded for event in station.of(TriggerRefused)] == [True]
    assert State.ERROR in [event.state for event in station.of(StateChanged)]


# from an exception to ERROR


class StrangeError(Exception):
    """An exception whose text cannot be made."""

    def __str__(self) -> str:
        raise RuntimeError("no text")


EXCEPTIONS: tuple[BaseException, ...] = (
    SetRejected("set rejected: saturated"),
    CameraError("no frame"),
    CalibrationError("of another rig"),
    InputError("bad input"),
    OSError(28, "No space left on device"),
    ValueError("a value"),
    MemoryError(),
    RecursionError("too deep"),
    StrangeError(),
    AssertionError(),
    KeyboardInterrupt(),
    SystemExit(0),
    GeneratorExit(),
)
STAGES = ("capture", "inspect", "fields", "save")


def raising(error: BaseException) -> Any:
    def work(*_: Any) -> NoReturn:
        raise error

    return work


def fail_in(station: Bench, stage: str, error: BaseException) -> None:
    """Let a stage fail for the second part."""
    calls = 0

    def once(work: Any) -> Any:
        def counted(*values: Any) -> Any:
            nonlocal calls
            calls += 1
            return raising(error)() if calls == 2 else work(*values)

        return counted

    if stage == "capture":
        station.camera.on_capture = once(lambda _: None)
    elif stage == "inspect":
        station.inspector.inspect = once(station.inspector.inspect)
    elif stage == "fields":

        class Failing(Said):
            def recorded(self, part: PartResult) -> PartResult:
                return once_recorded(self, part)

        once_recorded = once(Said.recorded)
        station.inspector.inspect = lambda _: Failing(PASSED)
    else:
        station.save = once(station.save)


@pytest.mark.parametrize("error", EXCEPTIONS, ids=lambda each: type(each).__name__)
@pytest.mark.parametrize("stage", STAGES)
def test_whatever_a_stage_raises_makes_the_part_an_error(
    station: Bench, stage: str, error: BaseException
) -> None:
    fail_in(station, stage, error)
    if isinstance(error, Exception):
        station.run(one_after_the_other(3), count=3)
        expected = [Decision.PASS, Decision.ERROR, Decision.PASS]
    else:  # the part is an ERROR, and the station stops
        with pytest.raises(type(error)):
            station.run(one_after_the_other(3), count=3)
        expected = [Decision.PASS, Decision.ERROR, Decision.PASS][: len(station.announced())]
        assert len(expected) >= 2
    assert [decision for _, decision in station.announced()] == expected
    assert station.rows() == station.announced()
    [failed] = [e.result for e in station.of(PartAnnounced) if e.result.verdict.causes]
    assert failed.number == 2
    assert failed.verdict.reason
    assert (failed.set_file is None) == (stage in ("capture", "save"))


@pytest.mark.parametrize(
    ("stage", "error", "cause"),
    [
        ("capture", SetRejected("saturated"), Cause.CAPTURE),
        ("capture", HardwareError("gone"), Cause.RIG),
        ("capture", CalibrationError("old"), Cause.CALIBRATION),
        ("capture", MemoryError(), Cause.UNFORESEEN),
        ("inspect", ValueError("shape"), Cause.UNFORESEEN),
        ("save", InputError("disk full"), Cause.STORAGE),
    ],
)
def test_an_error_names_its_cause(
    station: Bench, stage: str, error: Exception, cause: Cause
) -> None:
    fail_in(station, stage, error)
    station.run(one_after_the_other(2), count=2)
    assert station.of(PartAnnounced)[1].result.verdict.causes == (cause,)


class Silent(Said):
    def recorded(self, part: PartResult) -> PartResult:  # noqa: ARG002
        return None  # type: ignore[return-value]


@pytest.mark.parametrize(
    "said",
    [
        None,
        Silent(PASSED),
        Said(None),  # type: ignore[arg-type]
        Said("PASS"),  # type: ignore[arg-type]
        object(),
    ],
)
def test_an_inspector_without_a_verdict_passes_nothing(station: Bench, said: Any) -> None:
    station.inspector.inspect = lambda _: said
    station.run(one_after_the_other(1), count=1)
    assert [decision for _, decision in station.announced()] == [Decision.ERROR]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "text", 1j])
def test_a_measure_that_no_row_can_hold_passes_nothing(station: Bench, value: Any) -> None:
    class Strange(Said):
        def recorded(self, part: PartResult) -> PartResult:
            return replace(part, verdict=self.verdict, distance=value)

    station.inspector.inspect = lambda _: Strange(PASSED)
    station.run(one_after_the_other(1), count=1)
    assert [decision for _, decision in station.announced()] == [Decision.ERROR]


def test_a_store_that_fails_strangely_ends_the_run_without_an_announcement(
    station: Bench,
) -> None:
    add = station.store.add
    station.store.add = raising(ValueError("a defect"))  # type: ignore[method-assign]
    with pytest.raises(ValueError, match="a defect"):
        station.run(one_after_the_other(1), count=1)
    assert station.announced() == station.rows() == []
    station.store.add = add  # type: ignore[method-assign]
    station.events.clear()
    station.run(one_after_the_other(1), count=1)
    [recovered] = station.of(PartRecovered)
    assert recovered.result.verdict.causes == (Cause.INTERRUPTED,)
    assert recovered.result.set_file is not None
    assert station.rows() == [(*ids(1), Decision.ERROR), (*ids(2), Decision.PASS)]


# rig and self-test


def test_a_lost_rig_is_reconnected_between_parts(station: Bench) -> None:
    def capture(number: int) -> None:
        if number == 1:
            raise CameraError("the camera was unplugged")

    opens = 0

    def fail_twice() -> None:
        nonlocal opens
        opens += 1
        if opens in (2, 3):
            raise CameraError("no camera")

    station.camera.on_capture, station.camera.on_open = capture, fail_twice
    station.run(one_after_the_other(2), count=2)
    assert [decision for _, decision in station.announced()] == [Decision.ERROR, Decision.PASS]
    assert opens == 4
    states = [event.state for event in station.of(StateChanged)]
    # Another reason is told, the same one is not told again.
    assert states == [
        State.INITIALIZED, State.READY, State.EXECUTING, State.ERROR, State.ERROR,
        State.INITIALIZED, State.READY, State.EXECUTING, State.PREOPERATIONAL,
    ]  # fmt: skip


def test_a_set_that_is_rejected_does_not_close_the_rig(station: Bench) -> None:
    fail_in(station, "capture", SetRejected("set rejected: LED 1 gives 61 %"))
    station.run(one_after_the_other(3), count=3)
    assert station.camera.opened == 1


@pytest.mark.parametrize("is_raised", [True, False])
def test_a_rig_that_fails_at_the_start_ends_the_run(station: Bench, is_raised: bool) -> None:
    if is_raised:
        station.camera.on_open = raising(CameraError("no camera"))
    else:
        station.camera.checks = [Check("LED 1", "fault", "dead", "check its wiring")]
    with pytest.raises(CameraError if is_raised else SelfTestFailed):
        station.run(one_after_the_other(1), count=1)
    assert station.announced() == []
    assert not station.camera.is_open


# clock, interruption


def test_an_interrupt_while_the_threads_start_ends_them(
    station: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    start, others = threading.Thread.start, {*threading.enumerate()}

    def started(thread: threading.Thread) -> None:
        if thread.name == "triggers":
            raise KeyboardInterrupt
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", started)
    with pytest.raises(KeyboardInterrupt):
        station.run(one_after_the_other(1))
    left = {*threading.enumerate()} - others
    assert not [each.name for each in left if each.name.startswith("station")]


def test_a_clock_that_is_set_back_is_noted(station: Bench) -> None:
    shift = timedelta()
    station.clock = StationClock(utc=lambda: datetime.now(UTC) + shift)

    def capture(number: int) -> None:
        nonlocal shift
        if number == 1:
            shift = timedelta(hours=-1)

    station.camera.on_capture = capture
    station.run(one_after_the_other(3), count=3)
    results = [event.result for event in station.of(PartAnnounced)]
    assert [result.part_id for result in results] == ids(1, 2, 3)
    assert [len(result.notes) for result in results] == [0, 1, 0]
    assert "3600 s" in results[1].notes[0]
    assert results[1].triggered_utc < results[0].triggered_utc
    assert all(0.0 <= result.timings_ms["capture"] < 60e3 for result in results)


def test_a_locked_database_delays_results_and_loses_none(station: Bench) -> None:
    """The store waits 0.2 s for a lock here, 20 s in a station."""
    database = station.folder.results
    locked = threading.Event()

    def inspect(_: CapturedSet) -> Said:
        if not locked.is_set():
            other = sqlite3.connect(database, isolation_level=None, check_same_thread=False)
            other.execute("BEGIN IMMEDIATE")
            threading.Timer(1.0, lambda: (other.execute("ROLLBACK"), other.close())).start()
            locked.set()
        return Said(PASSED)

    station.inspector.inspect = inspect
    station.run(one_after_the_other(1000), count=3)
    assert station.rows() == station.announced()
    assert [decision for _, decision in station.announced()] == 3 * [Decision.PASS]


def test_a_part_that_was_begun_only_becomes_an_error(station: Bench) -> None:
    for _ in range(2):
        station.store.begin(
            trigger="timer", triggered_utc="2026-01-02T03:04:05.678Z", simulated=True
        )
    damaged = station.folder.path / "parts/2026-01-02/part-000002.ome.tif"
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"II*\0 cut by a loss of power")
    station.run(one_after_the_other(1), count=1)
    first, second = (event.result for event in station.of(PartRecovered))
    assert (first.verdict.decision, first.verdict.causes) == (Decision.ERROR, (Cause.INTERRUPTED,))
    assert "no set was saved" in first.verdict.reason
    assert "set file is damaged" in second.verdict.reason
    assert second.set_file is None
    assert station.rows()[2] == (*ids(3), Decision.PASS)
