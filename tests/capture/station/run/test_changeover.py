"""A running station takes another recipe between two parts."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.config import CONFIG
from capture.station.domain.folder import LAST_RECIPE, StationFolder, first_recipe, keep_recipe
from capture.station.run.cycle import Station
from capture.station.run.events import (
    PartAnnounced,
    PartBegun,
    RecipeLoaded,
    State,
    StateChanged,
    TriggerRefused,
    Warned,
)
from capture.station.run.triggers import (
    Accepted,
    Asker,
    RecipeRefusal,
    RecipeRefused,
    Refusal,
    Refused,
    Trigger,
)
from classify.base.errors import InputError
from rig import HardwareError
from tests.capture.station.stations import (
    FIRST,
    PASSED,
    Bench,
    FakeRecipes,
    Manual,
    Said,
    bench,
)
from tests.waiting import Gate, until_so

WAIT_S = 60.0
KIM = Asker("kim", "engineer")


@pytest.fixture
def station(tmp_path: Path, captured: CapturedSet) -> Iterator[Bench]:
    with bench(tmp_path / "line-1", captured) as made:
        made.recipes = FakeRecipes()
        yield made


def recipes_of(station: Bench) -> FakeRecipes:
    assert station.recipes is not None
    return station.recipes


def ready(target: Station) -> None:
    assert target.wait_until_ready(WAIT_S)


def trigger(target: Station, recipe: str | None = None) -> Any:
    return target.submit(Trigger("timer", recipe=recipe))


def refusal(target: Station, name: str = "brass") -> RecipeRefused:
    with pytest.raises(RecipeRefused) as raised:
        target.load_recipe(name, KIM)
    return raised.value


class Asking(threading.Thread):
    """Asks for a recipe in a thread of its own; `answer` is the recipe or the refusal."""

    def __init__(self, target: Station, name: str = "brass") -> None:
        super().__init__()
        self._target, self._name = target, name
        self.start()

    def run(self) -> None:
        self.answer: Any = None
        try:
            self.answer = self._target.load_recipe(self._name, KIM)
        except RecipeRefused as error:
            self.answer = error


def judged_by(station: Bench) -> list[str | None]:
    return [each.result.recipe for each in station.of(PartAnnounced)]


def check_order(station: Bench) -> None:
    """Each part is judged by the recipe that was loaded when it was begun, and no other."""
    loaded, begun = None, {}
    for event in station.events:
        match event:
            case RecipeLoaded(name):
                loaded = name
                assert not begun, "a part is in progress"
            case PartBegun(part_id):
                begun[part_id] = loaded
            case PartAnnounced(result):
                assert result.recipe == begun.pop(result.part_id) == loaded


def test_parts_in_progress_keep_the_recipe_of_their_trigger(station: Bench) -> None:
    gate = Gate()
    station.camera.on_capture = lambda number: gate.hold() if number == 2 else None

    def feed(target: Station) -> None:
        for _ in range(2):
            ready(target)
            trigger(target)
        gate.until_reached()
        asking = Asking(target)
        assert isinstance(trigger(target), Refused)
        until_so(lambda: target._changeover.is_requested)
        gate.open()
        asking.join(WAIT_S)
        assert asking.answer == RecipeLoaded("brass", 1, asking.answer.sha256, "kim")
        assert isinstance(trigger(target), Accepted)  # it is ready as soon as it has answered
        ready(target)

    station.run(Manual(feed))
    assert judged_by(station) == [FIRST, FIRST, "brass"]
    check_order(station)
    states = [each.state for each in station.of(StateChanged)]
    # No Ready between the part in progress and the change: a trigger would be refused.
    assert states[-6:] == [
        State.EXECUTING, State.INITIALIZED, State.READY, State.EXECUTING, State.READY,
        State.PREOPERATIONAL,
    ]  # fmt: skip
    [refused] = station.of(TriggerRefused)
    assert refused.recorded


@pytest.mark.parametrize("seed", range(3))
def test_no_part_is_judged_by_a_mixture_whenever_triggers_and_changes_come(
    station: Bench, seed: int
) -> None:
    names = ["brass", "tin", FIRST, "brass"] if seed else ["tin"] * 4

    def feed(target: Station) -> None:
        is_over = threading.Event()
        ready(target)

        def load() -> None:
            try:
                for name in names:
                    target.load_recipe(name, KIM)
            finally:
                is_over.set()

        asking = threading.Thread(target=load)
        asking.start()
        while not is_over.is_set():
            trigger(target) if seed == 2 else ready(target)
            trigger(target)
        asking.join()
        ready(target)
        trigger(target)
        ready(target)

    station.run(Manual(feed))
    check_order(station)
    assert [each.name for each in station.of(RecipeLoaded)] == [FIRST, *names]
    assert judged_by(station)[-1] == names[-1]


@pytest.mark.parametrize(("buffers", "kind"), [(1, Refusal.BUSY), (2, Refusal.NOT_READY)])
def test_a_recipe_waits_for_the_parts_in_progress_not_for_a_buffer(
    station: Bench, buffers: int, kind: Refusal
) -> None:
    gate = Gate()
    station.inspector.inspect = lambda _: gate.hold() or Said(PASSED)

    def feed(target: Station) -> None:
        ready(target)
        trigger(target)
        gate.until_reached()
        asking = Asking(target)
        until_so(lambda: target._changeover.is_requested)
        refused = trigger(target)
        gate.open()
        asking.join(WAIT_S)
        assert asking.answer.name == "brass"
        assert isinstance(refused, Refused)
        assert refused.kind is kind

    station.run(Manual(feed), buffers=buffers)
    check_order(station)


@pytest.mark.parametrize("kind", [RecipeRefusal.NOT_APPROVED, RecipeRefusal.CHALLENGE])
def test_a_recipe_that_cannot_be_loaded_leaves_the_station_ready_with_the_old_one(
    station: Bench, kind: RecipeRefusal
) -> None:
    def refuse(_: str) -> None:
        raise RecipeRefused("it cannot", kind)

    recipes_of(station).on_load = refuse

    def feed(target: Station) -> None:
        ready(target)
        refused = refusal(target)
        assert (str(refused), refused.kind) == ("it cannot", kind)
        assert isinstance(trigger(target), Accepted)
        ready(target)

    station.run(Manual(feed))
    assert judged_by(station) == [FIRST]
    [warning] = station.of(Warned)
    assert "brass" in warning.text
    assert "it cannot" in warning.text
    assert [each.state for each in station.of(StateChanged)].count(State.INITIALIZED) == 1


@pytest.mark.parametrize("step", ["use", "test", "keep"])
def test_a_rig_that_fails_with_the_new_recipe_is_opened_anew_with_the_old_one(
    station: Bench, step: str
) -> None:
    recipes = recipes_of(station)
    used: list[str] = []

    def fail(name: str) -> None:
        used.append(name)
        if name == "brass":
            raise HardwareError("exposure_ms = 900: not possible")

    if step == "keep":
        recipes.on_keep = fail
    else:
        station.camera.on_use = fail

    def feed(target: Station) -> None:
        ready(target)
        if step == "test":
            station.camera.on_use = used.append
            is_dead = HardwareError("a dead LED: not possible")
            station.camera.test = Mock(side_effect=[is_dead, []])  # type: ignore[method-assign]
        refused = refusal(target)
        assert "not possible" in str(refused)
        assert refused.kind is RecipeRefusal.RIG
        ready(target)
        assert isinstance(trigger(target), Accepted)
        ready(target)

    station.run(Manual(feed))
    assert judged_by(station) == [FIRST]
    assert station.camera.opened == 2
    assert used == (["brass"] if step == "keep" else ["brass", FIRST])


def test_the_asker_has_an_answer_when_the_rig_refuses_the_old_settings_too(
    station: Bench,
) -> None:
    def fail(name: str) -> None:
        raise HardwareError(f"the camera refuses the settings of {name}")

    station.camera.on_use = fail

    def feed(target: Station) -> None:
        ready(target)
        asking = Asking(target)
        asking.join(WAIT_S)
        assert not asking.is_alive()
        assert "settings of brass" in str(asking.answer)

    station.run(Manual(feed))


def test_one_recipe_is_loaded_at_a_time(station: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("capture.station.run.changeover.TIMEOUT_S", 0.01)
    gate = Gate()
    recipes_of(station).on_load = gate.hold

    def feed(target: Station) -> None:
        ready(target)
        first = Asking(target)
        gate.until_reached()
        assert refusal(target, "tin").kind is RecipeRefusal.BUSY
        assert isinstance(trigger(target), Accepted)  # parts go on meanwhile
        gate.open()
        first.join(WAIT_S)
        assert first.answer.name == "brass"

    station.run(Manual(feed))
    check_order(station)


def test_a_station_that_fails_or_stops_refuses_the_recipe_that_waits(station: Bench) -> None:
    gate = Gate()
    answers: list[Asking] = []

    def inspect(_: CapturedSet) -> Any:
        gate.hold()
        raise RuntimeError

    station.inspector.inspect = inspect

    def feed(target: Station) -> None:
        ready(target)
        trigger(target)
        gate.until_reached()
        answers.append(Asking(target))
        until_so(lambda: target._changeover.is_requested)
        assert trigger(target).kind is Refusal.NOT_READY
        target.stop()  # type: ignore[attr-defined]
        assert trigger(target).kind is Refusal.STOPPING
        answers.append(Asking(target))
        gate.open()

    station.run(Manual(feed))
    for each in answers:
        each.join(WAIT_S)
        assert each.answer.kind is RecipeRefusal.NOT_READY
        assert "stops" in str(each.answer)
    assert judged_by(station) == [FIRST]
    assert recipes_of(station).present.recipe.name == FIRST


def test_a_stop_ends_the_loading_of_a_recipe(station: Bench) -> None:
    loading = threading.Event()
    recipes = recipes_of(station)
    answers: list[Asking] = []

    def replay(_: str) -> None:
        loading.set()
        until_so(lambda: bool(recipes.raise_if_cancelled()))  # type: ignore[func-returns-value]

    recipes.on_load = replay

    def feed(target: Station) -> None:
        ready(target)
        answers.append(Asking(target))
        assert loading.wait(WAIT_S)

    station.run(Manual(feed))
    [asking] = answers
    asking.join(WAIT_S)
    assert (str(asking.answer), asking.answer.kind) == (
        "the station stops",
        RecipeRefusal.NOT_READY,
    )


def test_a_station_in_error_or_without_recipes_loads_none(station: Bench) -> None:
    def feed(target: Station) -> None:
        ready(target)
        station.camera.on_capture = fail
        trigger(target)
        while target.wait_until_ready(0.0):
            pass
        refused = refusal(target)
        assert (refused.kind, "gone" in str(refused)) == (RecipeRefusal.NOT_READY, True)

    def fail(_: int) -> None:
        raise HardwareError("the camera is gone")

    station.run(Manual(feed), reconnect_s=30.0)
    station.recipes = None
    station.camera.on_capture = lambda _: None

    def collect(target: Station) -> None:
        ready(target)
        assert refusal(target).kind is RecipeRefusal.NOT_READY

    station.run(Manual(collect))


def test_a_trigger_that_requires_another_recipe_is_refused(station: Bench) -> None:
    def feed(target: Station) -> None:
        ready(target)
        assert trigger(target, "brass").kind is Refusal.RECIPE
        assert isinstance(trigger(target, FIRST), Accepted)
        target.load_recipe("brass", KIM)
        assert trigger(target, FIRST).kind is Refusal.RECIPE
        assert isinstance(trigger(target, "brass"), Accepted)

    station.run(Manual(feed))
    assert judged_by(station) == [FIRST, "brass"]
    assert [each.recorded for each in station.of(TriggerRefused)] == [True, True]


def test_a_restart_begins_with_the_recipe_that_was_loaded_last(station: Bench) -> None:
    folder = station.folder
    assert first_recipe(folder) == "example"
    keep_recipe(folder, "brass")
    assert first_recipe(StationFolder(folder.path)) == "brass"
    path = folder.path / CONFIG
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('recipe = "example"', 'recipe = "tin"'), encoding="utf-8")
    assert first_recipe(StationFolder(folder.path)) == "tin"  # a newer wish
    keep_recipe(StationFolder(folder.path), "brass")
    assert first_recipe(StationFolder(folder.path)) == "brass"


@pytest.mark.parametrize("text", ["", '{"configured": "example", "loaded": "../x"}'])
def test_a_damaged_file_of_the_last_recipe_is_named_with_the_way_out(
    station: Bench, text: str
) -> None:
    (station.folder.path / LAST_RECIPE).write_text(text, encoding="utf-8")
    advice = "remove it to begin with recipe example"
    with pytest.raises(InputError, match=f"{LAST_RECIPE}: .*; {advice}"):
        first_recipe(station.folder)
