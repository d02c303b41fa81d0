"""The line between a handshake and a station, without a bus."""

import logging
import threading
import time
from typing import NoReturn

import pytest

from capture.station.domain.interface_config import ModbusConfig
from capture.station.line.handshake import Handshake
from capture.station.line.line import PlcLine
from capture.station.line.modbus import serving_modbus
from capture.station.line.registers import (
    PLC,
    PLC_ADDRESS,
    STATION,
    Command,
    decoded,
    encoded,
)
from capture.station.results.store import RefusedTrigger
from capture.station.run.live_station import LiveStation
from capture.station.run.triggers import RecipeRefusal, Refusal, Refused, Trigger
from tests.capture.station.line.lines import NOTHING
from tests.waiting import until_so

WAIT_S = 60.0


class Recorder:
    """Results that keep the refusals in memory, and a station that defies all requests."""

    def __init__(self) -> None:
        self.rows: list[RefusedTrigger] = []

    def refuse(self, *rows: RefusedTrigger) -> None:
        self.rows += rows


def ask_for(line: PlcLine, trigger_id: int, part_id: str) -> None:
    """Write a trigger, and take the trigger bit back."""
    values = NOTHING | {"trigger_id": trigger_id, "part_id": part_id}
    line.write(PLC_ADDRESS, encoded(PLC, values | {"commands": Command.TRIGGER}))
    line.write(PLC_ADDRESS, encoded(PLC, values | {"commands": 0}))


def test_refusals_before_the_station_takes_triggers_are_recorded_with_it() -> None:
    live, results = LiveStation("line-1", simulated=True), Recorder()
    line = PlcLine(live, Handshake(session=7, plc_triggers=False, station=live.state), last_s=0.0)
    with line:
        ask_for(line, 1, "A-1")
        with live.refusals.recording(results, lambda: True):  # type: ignore[arg-type]
            ask_for(line, 2, "A-2")
    assert [(row.part_id, row.simulated) for row in results.rows] == [("A-1", True), ("A-2", True)]


def test_a_plc_that_comes_before_the_station_takes_triggers_is_refused() -> None:
    live, results = LiveStation("line-1", simulated=True), Recorder()
    handshake = Handshake(session=7, plc_triggers=True, station=live.state, recipes=("brass",))
    line = PlcLine(live, handshake, last_s=0.0)
    with line, live.refusals.recording(results, lambda: True):  # type: ignore[arg-type]
        values = NOTHING | {"trigger_id": 1, "part_id": "A-1", "commands": Command.TRIGGER}
        line.write(PLC_ADDRESS, encoded(PLC, values))
        until_so(lambda: decoded(STATION, line.station_words())["error"] == Refusal.NOT_READY)
        line.write(PLC_ADDRESS, encoded(PLC, NOTHING))
        values = NOTHING | {"recipe": 1, "commands": Command.SELECT_RECIPE}
        line.write(PLC_ADDRESS, encoded(PLC, values))
        until_so(lambda: handshake.selection.loading is None)
    assert decoded(STATION, line.station_words())["select_error"] == RecipeRefusal.NOT_READY
    assert [row.part_id for row in results.rows] == ["A-1"]


def test_the_end_waits_for_the_last_answer_and_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, waits = threading.Event(), threading.Event()

    class Slow(Recorder):
        def submit(self, _: Trigger) -> Refused:
            asked.set()
            assert waits.wait(WAIT_S)
            return Refused("the station is stopping", Refusal.STOPPING)

    live = LiveStation("line-1", simulated=True)
    live.attach(Slow())  # type: ignore[arg-type]
    line = PlcLine(live, Handshake(session=7, plc_triggers=True, station=live.state), last_s=WAIT_S)
    is_busy = Handshake.is_busy.fget
    assert is_busy is not None

    def seen_busy(handshake: Handshake) -> bool:
        if threading.current_thread() is threading.main_thread() and asked.is_set():
            waits.set()
        return bool(is_busy(handshake))

    monkeypatch.setattr(Handshake, "is_busy", property(seen_busy))
    with line:
        ask_for(line, 1, "A-1")
        assert asked.wait(WAIT_S)
        ended_s = time.monotonic()
    assert time.monotonic() - ended_s < WAIT_S / 2


def test_a_defect_while_a_recipe_loads_is_an_answer_to_the_plc() -> None:
    class Defective(Recorder):
        def load_recipe(self, *_: object) -> NoReturn:
            raise ValueError("a defect")

    live = LiveStation("line-1", simulated=True)
    handshake = Handshake(session=7, plc_triggers=True, station=live.state, recipes=("brass",))
    line = PlcLine(live, handshake, last_s=0.0)
    with line:
        live.attach(Defective())  # type: ignore[arg-type]
        values = NOTHING | {"recipe": 1, "commands": Command.SELECT_RECIPE}
        line.write(PLC_ADDRESS, encoded(PLC, values))
        until_so(lambda: handshake.selection.loading is None)
    assert decoded(STATION, line.station_words())["select_error"] == RecipeRefusal.UNFORESEEN


def test_a_heartbeat_that_stops_is_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("a defect")

    live = LiveStation("line-1", simulated=True)
    line = PlcLine(live, Handshake(session=7, plc_triggers=False, station=live.state), last_s=0.0)
    monkeypatch.setattr(line, "tick", fail)
    with caplog.at_level(logging.ERROR), serving_modbus(line, ModbusConfig(port=0)):
        until_so(lambda: "heartbeat" in caplog.text)
    assert "a defect" in caplog.text
