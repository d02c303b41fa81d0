"""A PLC and an engineer change the recipe of a station with two taught textures, over sockets."""

import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from capture.station.domain.folder import station_folder
from capture.station.domain.verdict import Decision
from capture.station.line.example_client import run_ladder
from capture.station.line.handshake import Handshake
from capture.station.line.ladder import Judged
from capture.station.line.line import PlcLine
from capture.station.line.modbus import serving_modbus
from capture.station.line.registers import VERDICTS
from capture.station.run.cycle import Station
from capture.station.run.live_station import LiveStation
from capture.station.run.run import run_station
from capture.station.run.triggers import Asker, RecipeRefused
from tests.capture.station.line.lines import ANY_PORT
from tests.capture.station.production import SMALL_RIG
from tests.capture.station.two_recipes import (
    RECIPES,
    recipe_changes,
    rows_of,
    station_with_two_recipes,
)

PARTS = 4
ERROR, PASS = VERDICTS[Decision.ERROR], VERDICTS[Decision.PASS]


@pytest.mark.slow
def test_each_part_is_judged_by_the_recipe_that_its_plc_needs_whoever_loads_others_meanwhile(
    tmp_path: Path,
) -> None:
    folder = station_with_two_recipes(tmp_path)
    judged: list[tuple[Judged, str]] = []
    stopping, is_over = threading.Event(), threading.Event()

    class UntilStopped:
        def run(self, target: Station) -> None:
            stopping.wait()
            target.stop()  # type: ignore[attr-defined]

    def disturb() -> None:
        """Load the other recipe, again and again, also while parts are triggered."""
        while not is_over.wait(0.2):
            for name in RECIPES:
                try:
                    live.load_recipe(name, Asker("kim", "engineer"))
                except RecipeRefused:
                    continue

    with ExitStack() as stack:
        opened = stack.enter_context(station_folder(folder))
        live = LiveStation(opened.config.name, simulated=True)
        line = PlcLine(
            live, Handshake(7, is_trigger=True, station=live.state, recipes=RECIPES), last_s=0.0
        )
        stack.enter_context(live.telling(line.tell))
        where = stack.enter_context(serving_modbus(line, ANY_PORT))
        run = threading.Thread(target=run_station, args=(opened, SMALL_RIG, UntilStopped(), live))
        run.start()
        try:
            port = int(where.rpartition(":")[2])
            for round_, disturbed in enumerate((False, False, True, True)):
                recipe = round_ % 2 + 1
                parts = iter([f"{round_}-{number}" for number in range(PARTS)])
                other = threading.Thread(target=disturb)
                is_over.clear()
                if disturbed:
                    other.start()

                def take(part: Judged, name: str = RECIPES[recipe - 1]) -> None:
                    judged.append((part, name))

                run_ladder("127.0.0.1", port, lambda parts=parts: next(parts, None), take, recipe)
                is_over.set()
                if disturbed:
                    other.join()
        finally:
            is_over.set()
            stopping.set()
            run.join()
    rows = rows_of(folder)
    for part, needed in judged:
        if part.verdict != ERROR:
            row = rows[part.number or 0]
            assert (row.part_id, row.recipe) == (part.part_id, needed)
            # All parts are of rock: they pass by its recipe alone.
            assert (part.verdict == PASS) is (needed == RECIPES[0])
    quiet = [part for part, _ in judged if part.part_id[0] in "01"]
    assert all(part.verdict != ERROR for part in quiet)
    assert len(judged) == 4 * PARTS
    assert recipe_changes(folder) >= 3
