"""An example of a PLC's program: `python -m capture.station.line.example_client HOST PORT`.

`Ladder` is its side of the handshake, scan after scan, without I/O. The program needs
``pip install 'ps4rig[modbus]'``.
"""

import argparse
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from capture.station.domain.verdict import Cause, Decision
from capture.station.run.events import State

from .modbus import PlcConnection
from .registers import STATES, VERDICTS, Command, Status

_SCAN_S = 0.01
_RECONNECT_S = 0.2
# Time-out for an answer and for an exposure: longer than the restart of a database, and than three
# attempts at a set.
ANSWER_S = 30.0
_RESULT_S = 60.0
# Loading a recipe replays its challenge set if something has changed.
_RECIPE_S = 300.0
_ERROR = VERDICTS[Decision.ERROR]
_MAX_ID = 0xFFFF


@dataclass(frozen=True)
class Judged:
    """The decision of the PLC on a part: only PASS, which is 1, goes on."""

    part_id: str
    verdict: int  # code, as in the registers, like `cause`
    cause: int
    number: int | None  # None if the PLC rejected the part below the camera


class _Step(Enum):
    CLEAR = auto()  # wait until the station has reset its answers
    READY = auto()  # wait for a part, and for Ready
    RECIPE = auto()  # SelectRecipe is set
    ANSWER = auto()  # Trigger is set
    EXPOSURE = auto()  # the part must not move


_COMMANDS = {_Step.RECIPE: Command.SELECT_RECIPE, _Step.ANSWER: Command.TRIGGER}
_ANSWERS = Status.ACK | Status.REFUSED | Status.RECIPE_LOADED | Status.RECIPE_REFUSED


class Ladder:
    """Program of a PLC (in ladder logic) that triggers and sorts parts.

    For a part, set `recipe` (0: any), then `part_id`, which becomes None once the part may move.
    """

    def __init__(self) -> None:
        self.part_id: str | None = None
        self.recipe = 0
        self.judged: list[Judged] = []
        self._session = 0
        self._heartbeat = 0
        self._step = _Step.CLEAR
        self._is_acknowledging = False
        self._trigger_id = 0
        self._ack_number = 0
        self._deadline_s = 0.0
        self._number = 0
        # Parts without a result: id and deadline of each number.
        self._expected: dict[int, tuple[str, float]] = {}

    def scan(self, inputs: Mapping[str, Any], now_s: float) -> dict[str, Any]:
        """Return the registers that the PLC writes, from those of the station; both by name."""
        if inputs["session"] != self._session:
            self._begin_session(inputs)
        status = Status(inputs["status"])
        self._trigger(inputs, status, now_s)
        self._take_result(inputs, status, now_s)
        self._heartbeat = self._heartbeat % _MAX_ID + 1
        commands = _COMMANDS.get(self._step, Command(0))
        if self._is_acknowledging:
            commands |= Command.RESULTS_ACK
        return {
            "heartbeat": self._heartbeat,
            "commands": commands,
            "trigger_id": self._trigger_id,
            "ack_number": self._ack_number,
            "recipe": self.recipe,
            "part_id": self.part_id or "",
        }

    def _begin_session(self, inputs: Mapping[str, Any]) -> None:
        """Reset after a restart of the station or of this program: open requests get no answer."""
        for number, (part_id, _) in self._expected.items():
            self._judge(part_id, _ERROR, Cause.INTERRUPTED.plc_code, number)
        self._expected.clear()
        if self._step is _Step.ANSWER:
            self._reject()
        if self._step is _Step.EXPOSURE:
            self.part_id = None  # the part is among the expected ones
        self._session = inputs["session"]
        self._trigger_id = inputs["trigger_id"]
        self._step, self._is_acknowledging = _Step.CLEAR, False

    def _trigger(self, inputs: Mapping[str, Any], status: Status, now_s: float) -> None:
        if self._step is _Step.CLEAR and not status & _ANSWERS:
            self._step = _Step.READY
        if self._step is _Step.READY and self.part_id is not None:
            self._begin(inputs, status, now_s)
        elif self._step is _Step.RECIPE:
            self._await_recipe(inputs, status, now_s)
        elif self._step is _Step.ANSWER:
            is_mine = inputs["trigger_id"] == self._trigger_id
            if is_mine and Status.ACK in status and self.part_id is not None:
                self._number = inputs["number"]
                self._expected[self._number] = self.part_id, now_s + _RESULT_S
                self._deadline_s = now_s + ANSWER_S
                self._step = _Step.EXPOSURE
            elif (is_mine and Status.REFUSED in status) or now_s > self._deadline_s:
                self._reject()
        if self._step is _Step.EXPOSURE:
            if inputs["number"] == self._number and Status.EXPOSURE_COMPLETE in status:
                self.part_id, self._step = None, _Step.CLEAR
            elif now_s > self._deadline_s:
                # The part moves now, perhaps during an exposure, so its result must not count.
                self._expected.pop(self._number, None)
                self._reject()

    def _begin(self, inputs: Mapping[str, Any], status: Status, now_s: float) -> None:
        """Select the recipe of the part, or trigger the part."""
        if self.recipe not in (0, inputs["recipe"]):
            if inputs["state"] == STATES[State.READY]:
                self._deadline_s, self._step = now_s + _RECIPE_S, _Step.RECIPE
        elif Status.READY in status:
            self._trigger_id = self._trigger_id % _MAX_ID + 1
            self._deadline_s, self._step = now_s + ANSWER_S, _Step.ANSWER

    def _await_recipe(self, inputs: Mapping[str, Any], status: Status, now_s: float) -> None:
        is_mine = inputs["selected"] == self.recipe
        if is_mine and Status.RECIPE_LOADED in status:
            self._step = _Step.CLEAR
        elif (is_mine and Status.RECIPE_REFUSED in status) or now_s > self._deadline_s:
            self._reject()

    def _take_result(self, inputs: Mapping[str, Any], status: Status, now_s: float) -> None:
        if self._is_acknowledging:
            self._is_acknowledging = Status.RESULTS_VALID in status
        elif Status.RESULTS_VALID in status:
            self._ack_number, self._is_acknowledging = inputs["result_number"], True
            # An unexpected number belongs to a part that was rejected before.
            if self._ack_number in self._expected:
                part_id, _ = self._expected.pop(self._ack_number)
                self._judge(part_id, inputs["verdict"], inputs["cause"], self._ack_number)
        late = [number for number, (_, until_s) in self._expected.items() if now_s > until_s]
        for number in late:
            self._judge(self._expected.pop(number)[0], _ERROR, 0, number)

    def _reject(self) -> None:
        """Make the part below the camera an ERROR."""
        if self.part_id is not None:
            self._judge(self.part_id, _ERROR, 0, None)
        self.part_id, self._step = None, _Step.CLEAR

    def _judge(self, part_id: str, verdict: int, cause: int, number: int | None) -> None:
        self.judged.append(Judged(part_id, verdict, cause, number))


def run_ladder(
    host: str,
    port: int,
    next_part: Callable[[], str | None],
    judged: Callable[[Judged], None],
    recipe: int = 0,
) -> None:
    """Trigger the parts of `next_part` until it returns None, and report the verdicts.

    It reconnects without limit. Recipe 0 stands for any.
    """
    ladder = Ladder()
    ladder.recipe = recipe
    ladder.part_id = next_part()
    unjudged = int(ladder.part_id is not None)
    # A result can arrive before the PLC reads that the part may move.
    while unjudged > 0 or ladder.part_id is not None:
        try:
            with PlcConnection(host, port) as plc:
                while unjudged > 0 or ladder.part_id is not None:
                    plc.write(ladder.scan(plc.read(), time.monotonic()))
                    for part in ladder.judged:
                        judged(part)
                        unjudged -= 1
                    ladder.judged.clear()
                    if ladder.part_id is None:
                        ladder.part_id = next_part()
                        unjudged += ladder.part_id is not None
                    time.sleep(_SCAN_S)
        except ConnectionError:
            time.sleep(_RECONNECT_S)


def main() -> None:
    """Trigger parts and print a line of JSON for each."""
    parser = argparse.ArgumentParser(description="Play the PLC of a station.")
    parser.add_argument("host")
    parser.add_argument("port", type=int)
    parser.add_argument("--parts", type=int, default=10)
    parser.add_argument("--recipe", type=int, default=0, help="position of the recipe to load")
    parser.add_argument("--name", default="belt", help="beginning of the parts' ids")
    options = parser.parse_args()
    ids = (f"{options.name}-{number}" for number in range(1, options.parts + 1))
    run_ladder(
        options.host,
        options.port,
        lambda: next(ids, None),
        lambda part: print(json.dumps(vars(part)), flush=True),
        options.recipe,
    )


if __name__ == "__main__":
    main()
