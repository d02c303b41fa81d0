"""The line between a handshake and a station, without a bus."""

import logging
import threading
import time
from typing import Any
from unittest.mock import Mock

import pytest
from sqlalchemy import Table

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
from capture.station.run.live_station import LiveStation
from capture.station.run.triggers import RecipeRefusal, Refusal, Refused
from tests.capture.station.line.lines import NOTHING
from tests.waiting import Gate, until_so

WAIT_S = 60.0


class Recorder:
    """Results that keep the refusals in memory."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def append(self, _: Table, *rows: dict[str, Any]) -> None:
        self.rows += rows


def line_of(
    live: LiveStation, *, plc_triggers: bool = True, last_s: float = 0.0
) -> tuple[PlcLine, Handshake]:
    """A line without a bus, and its handshake."""
    handshake = Handshake(7, plc_triggers=plc_triggers, station=live.state, recipes=("brass",))
    return PlcLine(live, handshake, last_s=last_s), handshake


def write(line: PlcLine, **values: object) -> None:
    line.write(PLC_ADDRESS, encoded(PLC, NOTHING | values))


def shown(line: PlcLine, name: str) -> object:
    return decoded(STATION, line.station_words())[name]


def ask_for(line: PlcLine, trigger_id: int, part_id: str) -> None:
    """Write a trigger, and take the trigger bit back."""
    write(line, commands=Command.TRIGGER, trigger_id=trigger_id, part_id=part_id)
    write(line, trigger_id=trigger_id, part_id=part_id)


def test_refusals_before_the_station_takes_triggers_are_recorded_with_it() -> None:
    live, results = LiveStation("line-1", simulated=True), Recorder()
    line, _ = line_of(live, plc_triggers=False)
    with line:
        ask_for(line, 1, "A-1")
        with live.refusals.recording(results, lambda: True):  # type: ignore[arg-type]
            ask_for(line, 2, "A-2")
    assert [row["part_id"] for row in results.rows] == ["A-1", "A-2"]
    assert all(row["simulated"] for row in results.rows)


def test_a_plc_that_comes_before_the_station_takes_triggers_is_refused() -> None:
    live, results = LiveStation("line-1", simulated=True), Recorder()
    line, handshake = line_of(live)
    with line, live.refusals.recording(results, lambda: True):  # type: ignore[arg-type]
        write(line, commands=Command.TRIGGER, trigger_id=1, part_id="A-1")
        until_so(lambda: shown(line, "error") == Refusal.NOT_READY)
        write(line)
        write(line, commands=Command.SELECT_RECIPE, recipe=1)
        until_so(lambda: handshake.selection.loading is None)
    assert shown(line, "select_error") == RecipeRefusal.NOT_READY
    assert [row["part_id"] for row in results.rows] == ["A-1"]


def test_the_end_waits_for_the_last_answer_and_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    gate, refused = Gate(), Refused("the station is stopping", Refusal.STOPPING)
    live = LiveStation("line-1", simulated=True)
    live.attach(Mock(submit=lambda _: gate.hold() or refused))
    line, _ = line_of(live, last_s=WAIT_S)
    is_busy = Handshake.is_busy.fget
    assert is_busy is not None

    def seen_busy(handshake: Handshake) -> bool:
        if threading.current_thread() is threading.main_thread() and gate.is_reached:
            gate.open()
        return bool(is_busy(handshake))

    monkeypatch.setattr(Handshake, "is_busy", property(seen_busy))
    with line:
        ask_for(line, 1, "A-1")
        gate.until_reached()
        ended_s = time.monotonic()
    assert time.monotonic() - ended_s < WAIT_S / 2


def test_a_defect_while_a_recipe_loads_is_an_answer_to_the_plc() -> None:
    live = LiveStation("line-1", simulated=True)
    line, handshake = line_of(live)
    with line:
        live.attach(Mock(load_recipe=Mock(side_effect=ValueError("a defect"))))
        write(line, commands=Command.SELECT_RECIPE, recipe=1)
        until_so(lambda: handshake.selection.loading is None)
    assert shown(line, "select_error") == RecipeRefusal.UNFORESEEN


def test_a_heartbeat_that_stops_is_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    line, _ = line_of(LiveStation("line-1", simulated=True))
    monkeypatch.setattr(line, "tick", Mock(side_effect=ValueError("a defect")))
    with caplog.at_level(logging.ERROR), serving_modbus(line, ModbusConfig(port=0)):
        until_so(lambda: "heartbeat" in caplog.text)
    assert "a defect" in caplog.text
