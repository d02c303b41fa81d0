"""`Handshake`: the station's side of the handshake with a PLC, without I/O.

A trigger is identified by the id that the PLC gives it, a result by the number of its part. Both
differ from the last ones, so that an answer or result is not taken for an earlier one.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from capture.station.results.part_result import PartResult, require_given_part_id
from capture.station.run.events import (
    ExposureComplete,
    PartAnnounced,
    PartBegun,
    PartRecovered,
    RecipeLoaded,
    State,
)
from capture.station.run.live_view import LiveEvent
from capture.station.run.station_state import StationState
from capture.station.run.triggers import Accepted, Answer, Asker, RecipeRefusal, Refusal, Refused
from classify.base.errors import InputError

from .registers import (
    PAGE_VERSION,
    PLC,
    PLC_ADDRESS,
    PLC_WORDS,
    STATES,
    STATION,
    Command,
    Status,
    decoded,
    encoded,
    first_digits,
    registers_of,
)

SOURCE = "modbus"
ASKER = Asker("PLC", SOURCE)
# Largest number of unacknowledged results: with more, the program of the PLC does not run.
MAX_WAITING = 16
MAX_SESSION = (1 << 32) - 1
_ALL_COMMANDS = Command.TRIGGER | Command.RESULTS_ACK | Command.SELECT_RECIPE
_NUMBER_COUNT = 1 << 32  # registers show numbers of parts modulo this


@dataclass(frozen=True, eq=False)
class RecipeRequest:
    """A recipe that the PLC requests."""

    name: str


class _RecipeSelection:
    """The recipe that the PLC selected last, and the answer to the selection.

    If SelectRecipe falls while a recipe is being loaded, the loading goes on; no other recipe can
    be selected before it ends.
    """

    def __init__(self) -> None:
        self.position = 0
        self.loading: RecipeRequest | None = None  # until the station has answered
        # The answer, until SelectRecipe falls.
        self.is_loaded = False
        self.error: RecipeRefusal | None = None
        self._current: RecipeRequest | None = None  # None after SelectRecipe fell

    def select(self, position: int, name: str | None) -> None:
        """Handle a rise of SelectRecipe; `name` is None if no recipe has this position."""
        self.withdraw()
        self.position = position
        if self.loading is not None:
            self.error = RecipeRefusal.BUSY
        elif name is None:
            self.error = RecipeRefusal.UNKNOWN
        else:
            self._current = self.loading = RecipeRequest(name)

    def withdraw(self) -> None:
        """Handle a fall of SelectRecipe."""
        self._current, self.is_loaded, self.error = None, False, None

    def handle_refusal(self, request: RecipeRequest, kind: RecipeRefusal) -> None:
        """Handle the refusal of a request."""
        if self.loading is request:
            self.loading = None
        if self._current is request:
            self.error = kind

    def tell(self, event: RecipeLoaded) -> None:
        """Handle the event of a loaded recipe, whoever requested it."""
        request = self.loading
        if request is not None and (event.by, event.name) == (ASKER.name, request.name):
            self.loading = None
            self.is_loaded = self._current is request


@dataclass(frozen=True)
class TriggerRequest:
    """A trigger of the PLC."""

    trigger_id: int
    part_id: str | None  # None lets the station make the id of the part
    recipe: str | None = None  # name of the recipe that the PLC requires; None if it requires none
    # Reason for which the handshake refuses it; None if the station must answer.
    refusal: str | None = None


class Handshake:
    """Registers for a PLC, and reactions to its writes. Not thread-safe.

    A PLC that triggers gets only the results of its own parts.
    """

    def __init__(
        self,
        session: int,
        *,
        plc_triggers: bool,
        station: StationState,
        recipes: Sequence[str] = (),
    ) -> None:
        self._session, self._plc_triggers = session, plc_triggers
        self._station, self._recipes = station, recipes
        self._written = [0] * PLC_WORDS
        # The last trigger, and the trigger that the station has not answered.
        self._trigger_id = 0
        self._current: TriggerRequest | None = None
        self._unanswered: TriggerRequest | None = None
        self._is_accepted = False
        self._error: Refusal | None = None
        # Numbers of the last parts that were begun, exposed and announced.
        self._begun = self._exposed = self._announced = 0
        self._shown_result: PartResult | None = None
        self._waiting: deque[PartResult] = deque()
        self._overruns = 0
        self._is_wrong_ack = False
        self.heartbeat = 0  # incremented by the caller
        self.selection = _RecipeSelection()

    # The PLC.

    @property
    def commands(self) -> dict[str, Any]:
        """The registers that the PLC has written, by name."""
        return decoded(PLC, self._written)

    def plc_words(self) -> list[int]:
        """Return the registers that the PLC writes."""
        return list(self._written)

    def write(self, address: int, words: Sequence[int]) -> TriggerRequest | None:
        """Handle one write of the PLC, and return its trigger, if it is one.

        ValueError, without any change, for bits or registers that the PLC must not set.
        """
        first = address - PLC_ADDRESS
        if first < 0 or first + len(words) > PLC_WORDS:
            last = address + len(words) - 1
            raise ValueError(f"registers {address} to {last} are not all written by the PLC")
        written = list(self._written)
        written[first : first + len(words)] = words
        before, inputs = self.commands, decoded(PLC, written)
        if inputs["commands"] & ~int(_ALL_COMMANDS):
            raise ValueError(f"commands = {inputs['commands']:#x} has bits without a meaning")
        self._written = written
        old, new = Command(before["commands"]), Command(inputs["commands"])
        if Command.RESULTS_ACK in new & ~old:
            self._acknowledge(inputs["ack_number"])
        if Command.RESULTS_ACK not in new:
            self._is_wrong_ack = False
        self._show_next()
        if Command.SELECT_RECIPE not in new:
            self.selection.withdraw()
        elif Command.SELECT_RECIPE not in old:
            position = inputs["recipe"]
            self.selection.select(position, self._name_at(position))
        if Command.TRIGGER not in new:
            self._withdraw()
        elif Command.TRIGGER not in old:
            return self._trigger(inputs)
        return None

    def handle_answer(self, request: TriggerRequest, answer: Answer) -> None:
        """Handle the station's answer to the request that `write` returned last."""
        if self._unanswered is request:
            self._unanswered = None
        if isinstance(answer, Accepted):
            self._begun = max(self._begun, answer.number)
            self._show_next()
        if self._current is request:  # not withdrawn
            self._is_accepted = isinstance(answer, Accepted)
            if isinstance(answer, Refused):
                self._error = answer.kind

    # The station.

    def tell(self, live: LiveEvent) -> None:
        """Handle an event of the station, and the state after it."""
        self._station = live.state
        match live.event:
            case RecipeLoaded() as recipe:
                self.selection.tell(recipe)
            case PartBegun(_, number) if not self._plc_triggers:
                self._begun = number
            case ExposureComplete(_, number):
                self._exposed = number
            case PartAnnounced(result):
                self._announced = result.number
                self._add(result)
            case PartRecovered(result):
                # This run does not answer its trigger: an earlier run began the part.
                if result.trigger == SOURCE:
                    self._begun = self._exposed = max(self._begun, result.number)
                    self._announced = max(self._announced, result.number)
                self._add(result)
            case _:
                pass

    # What the PLC reads.

    def station_words(self) -> list[int]:
        """Return the registers that the station shows."""
        recipe = self._station.recipe
        return encoded(
            STATION,
            {
                "page": PAGE_VERSION,
                "session": self._session,
                "heartbeat": self.heartbeat,
                "status": self._status(),
                "state": STATES[self._station.state],
                "error": self._error or 0,
                "trigger_id": self._trigger_id,
                "number": self._begun,
                "recipe": self._position(),
                "recipe_version": 0 if recipe is None else recipe.version,
                "recipe_hash": first_digits(None if recipe is None else recipe.sha256),
                "overruns": self._overruns,
                "selected": self.selection.position,
                "select_error": self.selection.error or 0,
                **registers_of(self._shown_result),
            },
        )

    def _status(self) -> Status:
        is_exposed = self._unanswered is None and self._exposed >= self._begun
        is_ready = self._station.state is State.READY and is_exposed and self._refusal() is None
        bits = {
            Status.READY: is_ready,
            Status.ACK: self._is_accepted,
            Status.EXPOSURE_COMPLETE: is_exposed and self._begun > 0,
            Status.BUSY: self.is_busy,
            Status.RESULTS_VALID: self._shown_result is not None,
            Status.REFUSED: self._error is not None,
            Status.WRONG_ACK: self._is_wrong_ack,
            Status.SIMULATED: self._station.simulated,
            Status.RECIPE_LOADED: self.selection.is_loaded,
            Status.RECIPE_REFUSED: self.selection.error is not None,
        }
        return Status(sum(bit for bit, is_set in bits.items() if is_set))

    @property
    def is_busy(self) -> bool:
        """Whether a trigger has no answer, or a part no result."""
        return self._unanswered is not None or self._begun > self._announced

    @property
    def has_results(self) -> bool:
        """Whether there are results that the PLC has not acknowledged."""
        return self._shown_result is not None or bool(self._waiting)

    # Triggers.

    def _trigger(self, inputs: dict[str, Any]) -> TriggerRequest:
        trigger_id, part_id = inputs["trigger_id"], inputs["part_id"] or None
        is_new = trigger_id not in (0, self._trigger_id)
        self._withdraw()
        self._trigger_id = trigger_id
        reason = self._refusal()
        if not is_new:
            reason = Refusal.TRIGGER_ID, f"trigger id {trigger_id}: give another one, not 0"
        if reason is None and part_id is not None:
            try:
                require_given_part_id(part_id)
            except InputError as error:
                reason = Refusal.PART_ID, str(error)
        if reason is not None:
            self._error, text = reason
            return TriggerRequest(trigger_id, part_id, refusal=text)
        # The station checks the recipe again: another client may have had one loaded meanwhile.
        recipe = self._name_at(inputs["recipe"])
        self._current = self._unanswered = TriggerRequest(trigger_id, part_id, recipe)
        return self._current

    def _withdraw(self) -> None:
        """End the handshake of a trigger; a part that it began stays begun."""
        self._current, self._is_accepted, self._error = None, False, None

    def _refusal(self) -> tuple[Refusal, str] | None:
        """Why the handshake would refuse any trigger now."""
        if not self._plc_triggers:
            return Refusal.OTHER_TRIGGER, "triggers do not come from the PLC"
        if self._unanswered is not None:
            return Refusal.UNANSWERED, "busy: another trigger is not answered yet"
        if self.selection.loading is not None:
            return Refusal.RECIPE_LOADING, f"recipe {self.selection.loading.name} is being loaded"
        required = self.commands["recipe"]
        if required not in (0, self._position()):
            return Refusal.RECIPE, f"recipe {required} is not the loaded one"
        if len(self._waiting) + (self._shown_result is not None) >= MAX_WAITING:
            reason = f"{MAX_WAITING} results wait for an acknowledgement"
            return Refusal.RESULTS_WAITING, reason
        return None

    def _position(self) -> int:
        """Return the position of the loaded recipe, from 1, or 0."""
        recipe = self._station.recipe
        if recipe is None or recipe.name not in self._recipes:
            return 0
        return self._recipes.index(recipe.name) + 1

    def _name_at(self, position: int) -> str | None:
        return self._recipes[position - 1] if 1 <= position <= len(self._recipes) else None

    # Results.

    def _add(self, result: PartResult) -> None:
        if self._plc_triggers and result.trigger != SOURCE:
            return
        self._waiting.append(result)
        if not self._plc_triggers and len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self._overruns += 1
        self._show_next()

    def _acknowledge(self, number: int) -> None:
        if self._shown_result is not None and self._shown_result.number % _NUMBER_COUNT == number:
            self._shown_result = None
        else:
            self._is_wrong_ack = True

    def _show_next(self) -> None:
        """Show the next result, once the PLC has ended its acknowledgement of the last one."""
        is_acknowledging = bool(self.commands["commands"] & Command.RESULTS_ACK)
        if self._shown_result is None and self._waiting and not is_acknowledging:
            # A result can be known before the answer to its trigger.
            if self._plc_triggers and self._waiting[0].number > self._begun:
                return
            self._shown_result = self._waiting.popleft()
