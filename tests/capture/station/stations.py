"""Stations for tests: real cycle, store and files; rig and inspector are given by a test."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from capture.acquisition.attempts import capture_set
from capture.sets.captured_set import CapturedSet
from capture.station.domain.config import StationConfig
from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.recipe import Recipe
from capture.station.domain.verdict import Decision, Verdict
from capture.station.judge.inspector import Collector, Inspector
from capture.station.results.part_result import PartResult
from capture.station.results.store import ResultStore, open_store
from capture.station.run.cycle import Station
from capture.station.run.equipment import Equipment, ReportAlive
from capture.station.run.events import Event, PartAnnounced, PartRecovered
from capture.station.run.live_station import LiveStation, Subscriber
from capture.station.run.live_view import LiveEvent
from capture.station.run.outcome import PartJudge
from capture.station.run.recovery import finish_interrupted
from capture.station.run.run_recipes import UsableRecipe
from capture.station.run.station_clock import StationClock
from capture.station.run.station_state import StationState
from capture.station.run.triggers import Answer, Asker, PartSensor, Trigger
from rig import RigConfig, open_rig
from rig.doctor.check import Check

FIRST = "steel"
BEFORE = StationState("line-1", simulated=True, trigger="timer")
PASSED = Verdict(Decision.PASS, "it is good")


def published(*events: Event, before: StationState = BEFORE) -> list[LiveEvent]:
    """Events as a station publishes them, each with the state after it."""
    live = LiveStation(before.station, simulated=True)
    live.begin(before)
    for event in events:
        live.publish(event)
    return [each for each in live.events_after(before.event_id) or () if each.event in events]


@dataclass(frozen=True)
class Said:
    """What `FakeInspector` says."""

    verdict: Verdict

    def recorded(self, part: PartResult) -> PartResult:
        return replace(part, verdict=self.verdict)


class FakeInspector:
    """Passes every part, or does what a test says."""

    def __init__(self, inspect: Callable[[CapturedSet], Any] | None = None) -> None:
        self.inspect: Callable[[CapturedSet], Any] = inspect or (lambda _: Said(PASSED))


def small_set() -> CapturedSet:
    """A captured set of 16 x 16 px."""
    small = RigConfig().with_changes(camera={"width_px": 32, "height_px": 32})
    with open_rig(small) as rig:
        return capture_set(rig)


def make_days(folder: Path, until: datetime, days: int = 5) -> None:
    """Make the folders of the last days in a station."""
    for days_ago in range(days):
        day = (until - timedelta(days=days_ago)).date().isoformat()
        (folder / "parts" / day).mkdir(parents=True, exist_ok=True)


class FakeCamera:
    """A rig that delivers one set again and again, or does what a test says."""

    is_simulated = True
    set_bytes = 1000

    def __init__(self, captured: CapturedSet) -> None:
        self.captured = captured
        self.on_open: Callable[[], None] = lambda: None
        self.on_use: Callable[[str], None] = lambda _: None
        self.on_capture: Callable[[int], None] = lambda _: None
        self.checks: list[Check] = []
        self.is_open = False
        self.opened = 0

    def open(self) -> None:
        assert not self.is_open
        self.on_open()
        self.is_open = True
        self.opened += 1

    def use(self, inspector: Inspector | Collector) -> None:
        self.on_use(inspector.recipe.name)

    def test(self, *, is_start: bool) -> list[Check]:  # noqa: ARG002
        return self.checks

    def capture(self, number: int) -> tuple[CapturedSet, float]:
        assert self.is_open
        self.on_capture(number)
        return self.captured, time.monotonic()

    def close(self) -> None:
        self.is_open = False


class Manual:
    """A source of triggers that runs a function of the test."""

    def __init__(self, feed: Callable[[Station], None]) -> None:
        self.run = feed


def until_ready(station: Station) -> None:
    """Wait until the station takes a trigger."""
    while not station.wait_until_ready(0.1):
        assert not station.is_stopping


def one_after_the_other(count: int, answers: list[Answer] | None = None) -> Manual:
    """Trigger whenever the station is ready, `count` times."""

    def feed(station: Station) -> None:
        for _ in range(count):
            while not station.wait_until_ready(0.1):
                if station.is_stopping:
                    return
            answer = station.submit(Trigger("timer"))
            if answers is not None:
                answers.append(answer)

    return Manual(feed)


class FakeRecipes:
    """Recipes of which each passes every part, or which do what a test says."""

    def __init__(self) -> None:
        self.on_load: Callable[[str], None] = lambda _: None
        self.raise_if_cancelled: Callable[[], None] = lambda: None
        self.on_keep: Callable[[str], None] = lambda _: None
        self.present: UsableRecipe
        self.asker: Asker | None = None

    def begin(self, judge_of: Callable[[str], PartJudge], name: str) -> None:
        self._judge_of = judge_of
        self.present = self.usable(name)

    def usable(self, name: str, by: str = "") -> UsableRecipe:
        recipe = Recipe(name=name, passes=("rock",))
        return UsableRecipe(self._judge_of(name), Collector(recipe), by=by)

    def load(self, name: str, by: Asker, raise_if_cancelled: Callable[[], None]) -> UsableRecipe:
        self.asker, self.raise_if_cancelled = by, raise_if_cancelled
        self.on_load(name)
        return self.usable(name, by.name)

    def keep(self, recipe: UsableRecipe, by: Asker) -> None:  # noqa: ARG002
        self.on_keep(recipe.recipe.name)
        self.present = recipe


@dataclass
class Bench:
    """A station in a folder, and the events of its run."""

    folder: StationFolder
    store: ResultStore
    camera: FakeCamera
    inspector: FakeInspector
    events: list[Event] = field(default_factory=list)
    save: Callable[[CapturedSet, Path], None] = lambda captured, path: captured.save(path)
    clock: StationClock = field(default_factory=StationClock)
    prepare: Callable[[], list[Check]] = list
    listen: Subscriber = lambda _: None
    live: LiveStation | None = None
    report_alive: ReportAlive = lambda _: None
    recipes: FakeRecipes | None = None
    sensor: PartSensor | None = None

    def run(self, source: Any, count: int | None = None, **changes: Any) -> None:
        """Run the station; `events` holds what happened."""
        # A busy machine is late for some triggers.
        quick = {"reconnect_s": 0.01, "disk_floor_mb": 1, "max_trigger_age_s": 60.0}
        values = self.folder.config.model_dump() | quick
        config = StationConfig.model_validate(values | changes)

        def save(captured: CapturedSet, set_file: str) -> None:
            path = self.folder.path / set_file
            path.parent.mkdir(parents=True, exist_ok=True)
            self.save(captured, path)

        live = self.live or LiveStation(config.name, simulated=True)
        with live.telling(self.tell, self.listen):

            def prepare() -> list[Check]:
                found = finish_interrupted(self.folder.path, self.store, self.clock.now)
                for result in found:
                    live.publish(PartRecovered(result))
                return self.prepare()

            def judge_of(recipe: str) -> PartJudge:
                fields = {"recipe": recipe}
                return PartJudge(config.name, "Ada", self.inspector, fields, save, self.clock)

            judge = PartJudge(config.name, "Ada", self.inspector, {}, save, self.clock)
            if self.recipes is not None:
                self.recipes.begin(judge_of, FIRST)
                judge = self.recipes.present.judge
                live.publish(self.recipes.present.loaded_event)
            parts = Equipment(
                self.camera,
                judge,
                self.store,
                prepare,
                self.clock,
                live,
                self.sensor,
                report_alive=self.report_alive,
                recipes=self.recipes,
            )
            Station(self.folder.path, config, parts, count).run(source)

    def tell(self, live: LiveEvent) -> None:
        """Keep an event of the run."""
        self.events.append(live.event)

    def of(self, kind: type[Any]) -> list[Any]:
        """Events of a kind, in their order."""
        return [event for event in self.events if isinstance(event, kind)]

    def announced(self) -> list[tuple[str, Decision]]:
        """Identity and verdict of each announced part."""
        results = [event.result for event in self.of(PartAnnounced)]
        return [(result.part_id, result.verdict.decision) for result in results]

    def rows(self) -> list[tuple[str, Decision]]:
        """Identity and verdict of each row of the results."""
        results = [entry.result for entry in self.store.parts()]
        return [(result.part_id, result.verdict.decision) for result in results]


@contextmanager
def bench(folder: Path, captured: CapturedSet) -> Iterator[Bench]:
    """Open the station in `folder`, or make it, with a fake rig and a fake inspector."""
    if not folder.exists():
        make_station(folder)
    opened = StationFolder(folder)
    with open_store(opened.results, opened.config.name, create=True) as store:
        yield Bench(opened, store, FakeCamera(captured), FakeInspector())


@contextmanager
def running(run: Callable[[Manual], object]) -> Iterator[None]:
    """Run a station in a thread until the block ends."""
    stopping = threading.Event()

    def until_stopped(station: Station) -> None:
        stopping.wait()
        station.stop()

    thread = threading.Thread(target=run, args=(Manual(until_stopped),))
    thread.start()
    try:
        yield
    finally:
        stopping.set()
        thread.join()
