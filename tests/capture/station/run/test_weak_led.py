"""One rule for a weak LED: measured and compensated down to the level where parts are errors."""

from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.verdict import Cause, Decision
from capture.station.results.part_result import PartResult
from capture.station.run.control_chart import ControlChart
from capture.station.run.events import Event, PartAnnounced
from rig.config.lights import led_names
from tests.capture.station.production import SMALL_RIG, run_parts

LEDS = led_names([0, 90, 180, 270])


def results_with(line: Path, parts: int, *faults: dict[str, Any]) -> list[PartResult]:
    events: list[Event] = []
    leds = [{"led": 1, **fault} for fault in faults]
    rig = SMALL_RIG.with_changes(simulation={"clock": "virtual", "faults": {"leds": leds}})
    run_parts(line, parts, lambda live: events.append(live.event), rig)
    return [event.result for event in events if isinstance(event, PartAnnounced)]


@pytest.mark.parametrize("share", [0.0, 0.03, 0.05, 0.1])
def test_good_parts_pass_with_a_weak_led(line: Path, share: float) -> None:
    results = results_with(line, 3, {"kind": "dim", "share": share})
    assert {result.verdict.decision for result in results} == {Decision.PASS}


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_led_below_the_stop_makes_errors(line: Path, share: float) -> None:
    results = results_with(line, 2, {"kind": "dim", "share": share})
    for result in results:
        assert result.verdict.decision is Decision.ERROR
        assert result.verdict.causes[0] in (Cause.RIG, Cause.CAPTURE)


@pytest.mark.parametrize("share", [0.03, 0.1])
def test_a_led_that_stays_on_is_named_once_and_its_parts_are_judged(
    line: Path, share: float
) -> None:
    results = results_with(line, 3, {"kind": "stuck_on", "share": share})
    assert {result.verdict.decision for result in results} == {Decision.PASS}
    name = LEDS[1]
    assert all(any(name in note for note in result.notes) for result in results)
    chart = ControlChart(LEDS, print)
    told = [text for result in results for text in chart.add(result)]
    assert len(told) == 1
    assert told[0].startswith(name)


def test_a_led_that_stays_on_too_much_makes_errors(line: Path) -> None:
    [result] = results_with(line, 1, {"kind": "stuck_on", "share": 0.25})
    assert result.verdict.decision is Decision.ERROR
    assert LEDS[1] in result.verdict.reason


def test_no_led_stays_on_in_sound_sets(line: Path) -> None:
    assert [result.notes for result in results_with(line, 3)] == [(), (), ()]
