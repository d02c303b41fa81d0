"""The handshake without a bus: its codes, its page, and its rules in any order of events."""

from dataclasses import replace
from itertools import count
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    precondition,
    rule,
)

from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.line.example_client import ANSWER_S, Judged, Ladder
from capture.station.line.handshake import MAX_WAITING, Handshake, RecipeRequest, TriggerRequest
from capture.station.line.registers import (
    PLC,
    PLC_ADDRESS,
    STATES,
    STATION,
    VERDICTS,
    Command,
    Status,
    decoded,
    encoded,
)
from capture.station.results.part_result import PartResult
from capture.station.run.events import (
    Change,
    Event,
    ExposureComplete,
    PartAnnounced,
    PartBegun,
    PartRecovered,
    RecipeLoaded,
    State,
    StateChanged,
)
from capture.station.run.triggers import Accepted, RecipeRefusal, Refusal, Refused
from tests.capture.station.line.lines import NOTHING
from tests.capture.station.stations import BEFORE, published

UTC = "2026-01-02T03:04:05.678Z"
PASSED = Verdict(Decision.PASS, "it is good")
FAILED = Verdict(Decision.FAIL, "a scratch", (Cause.DEFECT, Cause.SHADOW))
INTERRUPTED = Verdict(Decision.ERROR, "interrupted", (Cause.INTERRUPTED,))


def result(number: int, verdict: Verdict = PASSED, **fields: Any) -> PartResult:
    given = {"part_id": f"part-{number:06d}", "trigger": "modbus"} | fields
    return PartResult(
        station="line-1", number=number, triggered_utc=UTC, exposed_utc=UTC, decided_utc=UTC,
        verdict=verdict, operator=None, simulated=True, software_version="0.1.0", **given,
    )  # fmt: skip


RECIPES = "brass", "steel"


def loaded(name: str, by: str = "") -> RecipeLoaded:
    return RecipeLoaded(name, 4, f"{len(name):08x}" * 8, by)


def tell(handshake: Handshake, event: Event) -> None:
    handshake.tell(*published(event, before=handshake._station))


def ready(**options: Any) -> Handshake:
    production = replace(BEFORE, simulated=False)
    handshake = Handshake(7, **{"plc_triggers": True, "station": production} | options)
    tell(handshake, StateChanged(State.READY, Change.TESTED))
    return handshake


def shown(handshake: Handshake) -> dict[str, Any]:
    return decoded(STATION, handshake.station_words())


def status(handshake: Handshake) -> Status:
    return Status(shown(handshake)["status"])


def write(handshake: Handshake, **values: Any) -> TriggerRequest | None:
    return handshake.write(PLC_ADDRESS, encoded(PLC, NOTHING | values))


def triggered(handshake: Handshake, trigger_id: int, **values: Any) -> TriggerRequest:
    request = write(handshake, commands=Command.TRIGGER, trigger_id=trigger_id, **values)
    assert request is not None
    return request


def accepted(handshake: Handshake, number: int, trigger_id: int = 1) -> None:
    """A whole trigger, with its exposure."""
    request = triggered(handshake, trigger_id)
    handshake.handle_answer(request, Accepted(f"part-{number:06d}", number))
    write(handshake)
    tell(handshake, ExposureComplete(f"part-{number:06d}", number))


def test_a_part_goes_through_the_handshake_of_the_readme() -> None:
    handshake = ready()
    assert status(handshake) == Status.READY
    request = triggered(handshake, 5, part_id="A-17")
    assert request == TriggerRequest(5, "A-17")
    assert status(handshake) == Status.BUSY
    handshake.handle_answer(request, Accepted("A-17", 3))
    assert status(handshake) == Status.BUSY | Status.ACK
    assert (shown(handshake)["trigger_id"], shown(handshake)["number"]) == (5, 3)
    write(handshake)
    assert status(handshake) == Status.BUSY
    tell(handshake, ExposureComplete("A-17", 3))
    assert status(handshake) == Status.BUSY | Status.EXPOSURE_COMPLETE | Status.READY
    tell(
        handshake,
        PartAnnounced(
            result(
                3, FAILED, part_id="A-17", recipe_sha256="89abcdef" * 8,
                orientation_deg=179.96, orientation_period_deg=180.0,
            ),
            12.0,
        ),
    )  # fmt: skip
    page = shown(handshake)
    assert Status(page["status"]) == Status.READY | Status.EXPOSURE_COMPLETE | Status.RESULTS_VALID
    assert page["result_number"] == 3
    assert (page["verdict"], page["cause"]) == (2, 45)
    assert (page["orientation"], page["result_hash"]) == (0, 0x89ABCDEF)
    assert page["result_part_id"] == "A-17"
    write(handshake, commands=Command.RESULTS_ACK, ack_number=3)
    page = shown(handshake)
    assert Status.RESULTS_VALID not in Status(page["status"])
    assert [page[name] for name in ("result_number", "verdict", "result_part_id")] == [0, 0, ""]


def test_every_verdict_and_state_has_a_code_of_its_own() -> None:
    for codes, words in ((VERDICTS, Decision), (STATES, State)):
        assert set(codes) == set(words)
        assert len(set(codes.values())) == len(codes)


@pytest.mark.parametrize(
    ("options", "values", "code"),
    [
        ({}, {"trigger_id": 0}, Refusal.TRIGGER_ID),
        ({}, {"trigger_id": 1}, Refusal.TRIGGER_ID),
        ({}, {"part_id": "../../etc"}, Refusal.PART_ID),
        ({}, {"part_id": "part-000001"}, Refusal.PART_ID),
        ({"recipes": ("brass", "steel")}, {"recipe": 1}, Refusal.RECIPE),
        ({}, {"recipe": 9}, Refusal.RECIPE),
        ({"plc_triggers": False}, {}, Refusal.OTHER_TRIGGER),
    ],
)
def test_a_trigger_that_the_handshake_refuses_has_a_code_and_is_to_be_recorded(
    options: dict[str, Any], values: dict[str, Any], code: Refusal
) -> None:
    handshake = ready(**options)
    tell(handshake, RecipeLoaded("steel", 4, "0" * 64))
    first = triggered(handshake, 1)
    if first.refusal is None:
        handshake.handle_answer(first, Refused("busy"))
    write(handshake)
    request = triggered(handshake, **{"trigger_id": 2} | values)
    assert request.refusal
    assert shown(handshake)["error"] == code
    assert status(handshake) & (Status.ACK | Status.REFUSED) == Status.REFUSED


def test_a_recipe_is_required_by_its_position() -> None:
    handshake = ready(recipes=("brass", "steel"))
    tell(handshake, RecipeLoaded("steel", 4, "0123456789abcdef" * 4))
    page = shown(handshake)
    assert (page["recipe"], page["recipe_version"], page["recipe_hash"]) == (2, 4, 0x01234567)
    write(handshake, recipe=1)
    assert Status.READY not in status(handshake)
    write(handshake, recipe=2)
    assert Status.READY in status(handshake)
    assert triggered(handshake, 1, recipe=2).refusal is None


def selecting(**options: Any) -> tuple[Handshake, RecipeRequest]:
    """A station with steel whose PLC has selected brass."""
    handshake = ready(recipes=RECIPES, **options)
    tell(handshake, loaded("steel"))
    write(handshake, commands=Command.SELECT_RECIPE, recipe=1)
    request = handshake.selection.loading
    assert request is not None
    return handshake, request


def test_a_plc_loads_a_recipe_by_its_position() -> None:
    handshake, request = selecting()
    assert request.name == "brass"
    assert status(handshake) == Status(0)  # not Ready: the PLC requires the new one
    tell(handshake, loaded("brass", "PLC"))
    page = shown(handshake)
    assert Status(page["status"]) == Status.RECIPE_LOADED | Status.READY
    assert [page[name] for name in ("recipe", "selected", "select_error")] == [1, 1, 0]
    write(handshake, recipe=1)
    assert status(handshake) == Status.READY
    assert triggered(handshake, 1, recipe=1) == TriggerRequest(1, None, "brass")


@pytest.mark.parametrize("kind", RecipeRefusal)
def test_a_recipe_that_is_not_loaded_has_its_code_and_the_old_one_stays(
    kind: RecipeRefusal,
) -> None:
    handshake, request = selecting()
    handshake.selection.handle_refusal(request, kind)
    page = shown(handshake)
    assert Status(page["status"]) == Status.RECIPE_REFUSED
    assert [page[name] for name in ("recipe", "selected")] == [2, 1]
    assert page["select_error"] == kind
    assert triggered(handshake, 1, recipe=1).refusal
    write(handshake)
    assert status(handshake) == Status.READY
    assert shown(handshake)["select_error"] == 0


@pytest.mark.parametrize("position", [0, 3])
def test_a_selection_that_names_no_recipe_is_refused(position: int) -> None:
    handshake = ready(recipes=RECIPES)
    write(handshake, commands=Command.SELECT_RECIPE, recipe=position)
    assert handshake.selection.loading is None
    assert shown(handshake)["select_error"] == RecipeRefusal.UNKNOWN


def test_a_trigger_that_comes_with_a_selection_or_before_its_answer_is_refused() -> None:
    handshake = ready(recipes=RECIPES)
    tell(handshake, loaded("steel"))
    both = Command.SELECT_RECIPE | Command.TRIGGER
    request = write(handshake, commands=both, recipe=2, trigger_id=1)
    assert request.refusal
    assert shown(handshake)["error"] == Refusal.RECIPE_LOADING
    write(handshake, recipe=2)  # withdrawn, and still being loaded
    assert triggered(handshake, 2, recipe=2).refusal
    write(handshake, commands=Command.SELECT_RECIPE, recipe=1)
    assert shown(handshake)["select_error"] == RecipeRefusal.BUSY
    tell(handshake, loaded("steel", "PLC"))
    assert Status.RECIPE_LOADED not in status(handshake)  # the answer to a selection withdrawn
    assert shown(handshake)["recipe"] == 2


def test_a_recipe_that_somebody_else_loads_is_no_answer() -> None:
    handshake, _ = selecting()
    for event in (
        StateChanged(State.INITIALIZED, Change.RECIPE),
        loaded("brass", "kim"),
        StateChanged(State.READY, Change.TESTED),
    ):
        tell(handshake, event)
        assert status(handshake) == Status(0)  # not Ready before its own answer
    assert handshake.selection.loading is not None


def test_a_trigger_that_was_withdrawn_gets_no_ack_and_the_next_one_waits_for_its_answer() -> None:
    handshake = ready()
    first = triggered(handshake, 1)
    write(handshake)
    second = triggered(handshake, 2)
    assert second.refusal
    assert shown(handshake)["error"] == Refusal.UNANSWERED
    handshake.handle_answer(first, Accepted("part-000001", 1))
    assert Status.ACK not in status(handshake)
    assert shown(handshake)["trigger_id"] == 2
    assert Status.BUSY in status(handshake)


def test_a_trigger_that_stays_set_begins_one_part() -> None:
    handshake = ready()
    request = triggered(handshake, 1)
    handshake.handle_answer(request, Accepted("part-000001", 1))
    for trigger_id in (1, 2, 3):
        assert write(handshake, commands=Command.TRIGGER, trigger_id=trigger_id) is None
    assert shown(handshake)["trigger_id"] == 1


def test_results_wait_for_each_other_and_for_the_end_of_the_acknowledgement() -> None:
    handshake = ready()
    for number in (1, 2):
        accepted(handshake, number, trigger_id=number)
        tell(handshake, PartAnnounced(result(number), 1.0))
    assert shown(handshake)["result_number"] == 1
    write(handshake, commands=Command.RESULTS_ACK, ack_number=2)
    assert status(handshake) & (Status.WRONG_ACK | Status.RESULTS_VALID) == (
        Status.WRONG_ACK | Status.RESULTS_VALID
    )
    assert shown(handshake)["result_number"] == 1
    write(handshake)
    assert Status.WRONG_ACK not in status(handshake)
    write(handshake, commands=Command.RESULTS_ACK, ack_number=1)
    assert Status.RESULTS_VALID not in status(handshake)
    write(handshake)
    assert shown(handshake)["result_number"] == 2


def test_a_result_is_not_shown_before_its_trigger_is_answered() -> None:
    handshake = ready()
    request = triggered(handshake, 1)
    tell(handshake, ExposureComplete("part-000001", 1))
    tell(handshake, PartAnnounced(result(1), 1.0))
    assert not status(handshake) & (Status.RESULTS_VALID | Status.EXPOSURE_COMPLETE)
    handshake.handle_answer(request, Accepted("part-000001", 1))
    assert status(handshake) & ~Status.READY == (
        Status.ACK | Status.RESULTS_VALID | Status.EXPOSURE_COMPLETE
    )


def test_a_plc_that_never_acknowledges_gets_no_further_part() -> None:
    handshake = ready()
    for number in range(1, MAX_WAITING + 1):
        accepted(handshake, number, trigger_id=number)
        tell(handshake, PartAnnounced(result(number), 1.0))
    assert Status.READY not in status(handshake)
    assert triggered(handshake, 99).refusal
    assert shown(handshake)["error"] == Refusal.RESULTS_WAITING
    assert shown(handshake)["result_number"] == 1


def test_a_plc_that_triggers_gets_the_results_of_its_own_parts_alone() -> None:
    handshake = ready()
    tell(handshake, PartBegun("key-1", 1))
    tell(handshake, PartAnnounced(result(1, trigger="http"), 1.0))
    assert status(handshake) == Status.READY
    assert shown(handshake)["number"] == 0


def test_a_plc_that_does_not_trigger_gets_all_results_and_the_last_ones_if_it_is_away() -> None:
    handshake = ready(plc_triggers=False)
    for number in range(1, MAX_WAITING + 4):
        tell(handshake, PartBegun("x", number))
        assert status(handshake) & (Status.EXPOSURE_COMPLETE | Status.BUSY) == Status.BUSY
        assert shown(handshake)["number"] == number
        tell(handshake, ExposureComplete("x", number))
        assert Status.EXPOSURE_COMPLETE in status(handshake)
        tell(handshake, PartAnnounced(result(number, trigger="sensor"), 1.0))
    assert shown(handshake)["overruns"] == 2
    assert shown(handshake)["result_number"] == 1  # what is shown stays
    write(handshake, commands=Command.RESULTS_ACK, ack_number=1)
    write(handshake)
    assert shown(handshake)["result_number"] == 4


def test_an_interrupted_part_of_an_earlier_run_is_shown_as_error() -> None:
    handshake = ready()
    tell(handshake, PartRecovered(result(4, INTERRUPTED)))
    tell(handshake, PartRecovered(result(5, INTERRUPTED, trigger="timer")))
    page = shown(handshake)
    assert Status.RESULTS_VALID in Status(page["status"])
    assert (page["result_number"], page["verdict"], page["cause"]) == (4, 4, 4)
    write(handshake, commands=Command.RESULTS_ACK, ack_number=4)
    write(handshake)
    assert shown(handshake)["result_number"] == 0


@pytest.mark.parametrize(
    ("address", "words"),
    [(PLC_ADDRESS + 1, [8]), (PLC_ADDRESS + 1, [0xFFFF]), (0, [1]), (PLC_ADDRESS + 56, [1])],
)
def test_nonsense_changes_nothing(address: int, words: list[int]) -> None:
    handshake = ready()
    before = handshake.station_words(), handshake.plc_words()
    with pytest.raises(ValueError, match=r"commands|registers"):
        handshake.write(address, words)
    assert (handshake.station_words(), handshake.plc_words()) == before


# What goes on by itself on a belt without faults.
STEPS = ("belt", "plc", "recipes", "parts", "answers", "exposures", "verdicts", "events")


class Belt(RuleBasedStateMachine):
    """A belt with a PLC and a station: all that may happen between them, in any order.

    Each side may stop and begin anew at any moment, what the PLC has read may be old when it
    writes, and the station's events come late. Parts need different recipes, and an engineer loads
    some, too.
    """

    def __init__(self) -> None:
        super().__init__()
        self.sessions, self.names = count(1), count(1)
        self.now_s = 0.0
        self.below_camera: str | None = None
        self.seen: dict[int, str | None] = {}  # what lay below the camera, by number
        self.rows: dict[int, PartResult] = {}
        self.session_of: dict[int, int] = {}
        self.judged: list[Judged] = []
        self.last = 0
        self.needs: dict[str, int] = {}
        self.loaded = "steel"
        self.judged_by: dict[int, str] = {}
        self.start_station()
        self.start_plc()

    def start_station(self) -> None:
        self.session = next(self.sessions)
        self.station = Handshake(self.session, plc_triggers=True, station=BEFORE, recipes=RECIPES)
        self.selected: RecipeRequest | None = None  # the last one that was answered
        self.request: TriggerRequest | None = None
        self.unanswered: tuple[TriggerRequest, int] | None = None
        self.exposing: int | None = None
        self.exposed: list[int] = []
        self.events: list[Any] = [loaded(self.loaded)]
        for number in self.seen.keys() - self.rows.keys():
            self.rows[number] = result(number, INTERRUPTED)
            self.events.append(PartRecovered(self.rows[number]))
        self.events.append(StateChanged(State.READY, Change.TESTED))

    def start_plc(self) -> None:
        self.ladder = Ladder()
        self.inputs: dict[str, Any] | None = None

    # The belt and the PLC.

    @precondition(lambda self: self.ladder.part_id is None)
    @rule(recipe=st.integers(0, len(RECIPES)))
    def bring_part(self, recipe: int) -> None:
        self.ladder.part_id = self.below_camera = f"belt-{next(self.names)}"
        self.ladder.recipe = self.needs[self.below_camera] = recipe

    @rule()
    def read(self) -> None:
        self.inputs = shown(self.station)

    @precondition(lambda self: self.inputs is not None)
    @rule(is_lost=st.booleans())
    def scan(self, is_lost: bool) -> None:
        assert self.inputs is not None
        written = self.ladder.scan(self.inputs, self.now_s)
        self.inputs = None
        if self.ladder.part_id is None:
            self.below_camera = None
        if not is_lost:
            self.write(written)

    @rule(stuck=st.sets(st.sampled_from(STEPS), max_size=1), rounds=st.integers(1, 6))
    def run(self, stuck: set[str], rounds: int) -> None:
        """Let both sides go on, but for what is stuck: so whole handshakes are reached."""
        for _ in range(rounds):
            for step in STEPS:
                if step not in stuck:
                    getattr(self, f"go_on_with_{step}")()

    def go_on_with_belt(self) -> None:
        if self.ladder.part_id is None:
            self.bring_part(len(self.needs) % (len(RECIPES) + 1))

    def go_on_with_plc(self) -> None:
        self.read()
        self.scan(is_lost=False)

    def go_on_with_recipes(self) -> None:
        if self.may_load_selected():
            self.load_selected()

    def go_on_with_parts(self) -> None:
        if self.request is not None and self.exposing is None:
            self.begin_part()

    def go_on_with_answers(self) -> None:
        if self.unanswered is not None:
            self.answer()

    def go_on_with_exposures(self) -> None:
        if self.exposing is not None:
            self.end_exposure()

    def go_on_with_verdicts(self) -> None:
        if self.exposed:
            self.judge(PASSED if self.exposed[0] % 2 else FAILED)

    def go_on_with_events(self) -> None:
        self.tell(len(self.events))

    def write(self, values: dict[str, Any]) -> None:
        request = self.station.write(PLC_ADDRESS, encoded(PLC, values))
        if request is not None and request.refusal is None:
            assert self.request is None
            assert self.unanswered is None
            self.request = request

    @rule()
    def wait_long(self) -> None:
        self.now_s += ANSWER_S + 1.0

    @precondition(lambda self: self.ladder.part_id is not None)
    @rule()
    def kill_plc(self) -> None:
        self.start_plc()

    # The station.

    def may_load(self) -> bool:
        """Whether no part is in progress."""
        return self.exposing is None and not self.exposed

    def may_load_selected(self) -> bool:
        return self.may_load() and self.station.selection.loading not in (None, self.selected)

    @precondition(may_load_selected)
    @rule()
    def load_selected(self) -> None:
        self.selected = self.station.selection.loading
        self.load(self.selected.name, "PLC")

    @precondition(lambda self: self.station.selection.loading not in (None, self.selected))
    @rule(kind=st.sampled_from(RecipeRefusal))
    def refuse_selected(self, kind: RecipeRefusal) -> None:
        request = self.station.selection.loading
        assert request is not None
        self.station.selection.handle_refusal(request, kind)

    @precondition(may_load)
    @rule(name=st.sampled_from(RECIPES))
    def load(self, name: str, by: str = "kim") -> None:
        self.loaded = name
        self.events += [
            StateChanged(State.INITIALIZED, Change.RECIPE),
            loaded(name, by),
        ]
        self.events += [StateChanged(State.READY, Change.TESTED)]

    @precondition(lambda self: self.request is not None and self.exposing is None)
    @rule()
    def begin_part(self) -> None:
        if self.request.recipe not in (None, self.loaded):
            self.refuse(Refusal.RECIPE)
            return
        self.unanswered, self.request = (self.request, self.begin()), None

    @precondition(lambda self: self.exposing is None)
    @rule()
    def begin_part_of_another_trigger(self) -> None:
        number = self.begin()
        self.rows[number] = result(number, FAILED, trigger="http")

    def begin(self) -> int:
        self.last += 1
        self.judged_by[self.last] = self.loaded
        self.seen[self.last], self.session_of[self.last] = self.below_camera, self.session
        self.exposing = self.last
        self.events += [
            StateChanged(State.EXECUTING, Change.TRIGGERED),
            PartBegun("", self.last),
        ]
        return self.last

    @precondition(lambda self: self.request is not None)
    @rule(kind=st.sampled_from(Refusal))
    def refuse(self, kind: Refusal) -> None:
        assert self.request is not None
        request, self.request = self.request, None
        self.station.handle_answer(request, Refused("it cannot", kind))

    @precondition(lambda self: self.unanswered is not None)
    @rule()
    def answer(self) -> None:
        assert self.unanswered is not None
        (request, number), self.unanswered = self.unanswered, None
        self.station.handle_answer(request, Accepted(f"part-{number:06d}", number))

    @precondition(lambda self: self.exposing is not None)
    @rule()
    def end_exposure(self) -> None:
        number = self.exposing
        assert number is not None
        if self.seen[number] != self.below_camera:
            self.seen[number] = None  # it moved
        self.exposed.append(number)
        self.exposing = None
        self.events += [
            ExposureComplete("", number),
            StateChanged(State.READY, Change.FREE),
        ]

    @precondition(lambda self: bool(self.exposed))
    @rule(verdict=st.sampled_from([PASSED, FAILED]))
    def judge(self, verdict: Verdict) -> None:
        number = self.exposed.pop(0)
        self.rows.setdefault(number, result(number, verdict))
        self.events.append(PartAnnounced(self.rows[number], 1.0))

    @precondition(lambda self: bool(self.events))
    @rule(most=st.integers(1, 4))
    def tell(self, most: int) -> None:
        for event in self.events[:most]:
            tell(self.station, event)
        del self.events[:most]

    @precondition(lambda self: self.session_of.get(self.last) == self.session)
    @rule()
    def kill_station(self) -> None:
        self.start_station()

    # What must hold.

    def teardown(self) -> None:
        """Whatever has happened, the line comes to work again."""
        self.wait_long()
        for _ in range(60):
            self.run(stuck=set(), rounds=1)
            self.no_result_is_taken_for_that_of_another_part()
        assert self.judged[-1].verdict != VERDICTS[Decision.ERROR]
        assert self.judged[-3].verdict != VERDICTS[Decision.ERROR]

    @invariant()
    def no_result_is_taken_for_that_of_another_part(self) -> None:
        for part in self.ladder.judged:
            assert part.part_id not in [each.part_id for each in self.judged], "judged twice"
            if part.verdict != VERDICTS[Decision.ERROR]:
                assert part.number is not None
                assert self.seen[part.number] == part.part_id
                assert part.verdict == VERDICTS[self.rows[part.number].verdict.decision]
                needed = self.needs[part.part_id]
                assert needed == 0 or self.judged_by[part.number] == RECIPES[needed - 1]
        self.judged += self.ladder.judged
        self.ladder.judged.clear()

    @invariant()
    def no_result_of_an_earlier_run_is_valid(self) -> None:
        page = shown(self.station)
        if Status.RESULTS_VALID in Status(page["status"]):
            number = page["result_number"]
            assert page["verdict"] == VERDICTS[self.rows[number].verdict.decision]
            if self.session_of[number] != self.session:
                assert page["cause"] == Cause.INTERRUPTED.plc_code

    @invariant()
    def nothing_is_accepted_and_refused(self) -> None:
        for both in (Status.ACK | Status.REFUSED, Status.RECIPE_LOADED | Status.RECIPE_REFUSED):
            assert status(self.station) & both != both


TestBelt = Belt.TestCase
TestBelt.settings = settings(max_examples=60, stateful_step_count=30)
