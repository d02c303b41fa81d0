"""A PLC line of a running station with a fake rig, and clients that play the PLC."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from capture.sets.captured_set import CapturedSet
from capture.station.domain.interface_config import ModbusConfig
from capture.station.line.handshake import Handshake
from capture.station.line.line import PlcLine
from capture.station.line.modbus import PlcConnection, serving_modbus
from capture.station.line.registers import (
    PLC,
    Command,
    Status,
    decoded,
)
from capture.station.run.events import TriggerRefused
from capture.station.run.live_station import LiveStation
from tests.capture.station.stations import Bench, bench, running
from tests.waiting import until_so

ANY_PORT = ModbusConfig(port=0)
WAIT_S = 60.0
SESSION = 77
NOTHING = decoded(PLC, [0] * 100)


@dataclass
class RunningLine:
    """A line and its station."""

    bench: Bench
    live: LiveStation
    port: int

    def client(self) -> PlcConnection:
        return PlcConnection("127.0.0.1", self.port, timeout_s=WAIT_S)

    def device(self) -> tuple[str, str]:
        [found] = [each for each in self.live.snapshot().devices if each.name == "plc"]
        return found.status, found.text

    def refused(self) -> list[str]:
        """Reasons of the triggers that are recorded as refused."""
        return [each.reason for each in self.bench.of(TriggerRefused) if each.recorded]


@contextmanager
def running_line(
    folder: Path,
    captured: CapturedSet,
    *,
    plc_triggers: bool = True,
    before: Callable[[Bench], None] = lambda _: None,
    session: int = SESSION,
    now_s: Callable[[], float] = time.monotonic,
) -> Iterator[RunningLine]:
    """Run a station in `folder` whose triggers come from a PLC; `before` changes its parts."""
    with ExitStack() as stack:
        station = stack.enter_context(bench(folder, captured))
        before(station)
        live = LiveStation(station.folder.config.name, simulated=True)
        handshake = Handshake(session, plc_triggers=plc_triggers, station=live.state)
        line = PlcLine(live, handshake, now_s, last_s=0.0)
        station.live, station.listen = live, line.tell
        with serving_modbus(line, ANY_PORT) as where, running(station.run):
            yield RunningLine(station, live, int(where.rpartition(":")[2]))


def until(plc: PlcConnection, bits: Status, *, is_set: bool = True) -> dict[str, Any]:
    """Read until bits of the status are set, or not; return what was read."""
    read: dict[str, Any] = {}

    def is_so() -> bool:
        read.update(plc.read())
        return (Status(read["status"]) & bits == bits) is is_set

    until_so(is_so)
    return read


def trigger(plc: PlcConnection, trigger_id: int, part_id: str = "") -> None:
    """Set Trigger, when the station is ready."""
    until(plc, Status.READY)
    given = {"commands": Command.TRIGGER, "trigger_id": trigger_id, "part_id": part_id}
    plc.write(NOTHING | given)


def acknowledge(plc: PlcConnection, number: int) -> None:
    """Acknowledge a result, and end the handshake."""
    plc.write(NOTHING | {"commands": Command.RESULTS_ACK, "ack_number": number})
    until(plc, Status.RESULTS_VALID, is_set=False)
    plc.write(NOTHING)
