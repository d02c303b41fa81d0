"""Tests of the gauge study."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.config import SimulatedParts
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.judge.gauge import (
    GaugeReport,
    Presentation,
    presentations_of,
    read_known_parts,
)
from capture.station.judge.simulated_gauge import known_parts
from classify.base.errors import InputError

PASS, FAIL, UNKNOWN = Decision.PASS, Decision.FAIL, Decision.UNKNOWN


def study(good: int, bad: int, *, alarms: int = 0, misses: int = 0) -> GaugeReport:
    """Three presentations of each part, the first of which are wrong."""
    shown, times = [], 3
    for kind, count, right, other, wrong in (
        ("good", good, PASS, UNKNOWN, alarms),
        ("bad", bad, FAIL, PASS, misses),
    ):
        for number in range(count * times):
            decision = other if number < wrong else right
            shown.append(Presentation(f"{kind} {number // times}", kind == "good", decision, "why"))
    return GaugeReport.of(shown, "example", None, simulated=True)


def test_a_faultless_study_states_what_it_does_not_show() -> None:
    found = study(25, 25)
    assert found.rating == "acceptable"
    assert found.misses.share == 0.0
    # 1 - 0.05 ** (1 / 25): parts count, not presentations.
    assert found.misses.bound == pytest.approx(0.1129, abs=1e-4)
    assert found.effectiveness.bound == pytest.approx(0.05 ** (1 / 50), abs=1e-4)
    assert "25 bad parts without a miss do not show 2%: that takes 149" in found.lines[-1]
    assert study(25, 149).misses.bound <= 0.02


@pytest.mark.parametrize(
    ("wrong", "rating"),
    [
        ({"misses": 3}, "acceptable"),  # 3 of 150
        ({"misses": 6}, "marginal"),
        ({"misses": 9}, "unacceptable"),
        ({"alarms": 7}, "acceptable"),
        ({"alarms": 15}, "marginal"),
        ({"alarms": 16}, "unacceptable"),
    ],
)
def test_the_limits_are_those_of_aiag(wrong: dict[str, int], rating: str) -> None:
    assert study(50, 50, **wrong).rating == rating


def test_a_part_that_is_wrong_once_is_not_effective() -> None:
    found = study(10, 10, misses=1)
    assert (found.effectiveness.events, found.effectiveness.trials) == (19, 20)
    assert (found.misses.events, found.misses.trials) == (1, 30)
    assert found.wrong == ("bad 0, bad, 1 of 3 times wrong: PASS, why",)


def test_without_bad_parts_nothing_is_acceptable() -> None:
    found = study(10, 0)
    assert found.rating == "unacceptable"
    assert found.misses.bound == 1.0
    assert any("misses: no trials" in line for line in found.lines)


def test_known_parts_are_found_among_the_results() -> None:
    known = {"K1": True, "K2": False, "K-3": True}
    good, bad = Verdict(PASS, "good"), Verdict(FAIL, "bad", (Cause.DEFECT,))
    recorded = [("K1", good), ("K1-2", bad), ("K2-1", good), ("K-3", good), ("K9", good)]
    found = presentations_of(known, recorded)
    assert [(each.part, each.is_right) for each in found] == [
        ("K1", True),
        ("K1", False),
        ("K2", False),
        ("K-3", True),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("K1,good\nK2\n", "line 2: give ID,good or ID,bad"),
        ("K1,fine\n", "line 1: give ID,good or ID,bad, not 'K1,fine'"),
        ("K1,good\nK1,bad\n", "line 2: K1 is good and bad"),
        ("\n", "names no part"),
        (f"K1,{'x' * 200_000}\n", "known.csv: not CSV"),
    ],
)
def test_a_wrong_list_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "known.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_known_parts(path)


def test_a_list_is_read_with_blanks_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "known.csv"
    path.write_text("\ufeffK1, Good\n\nK2,bad\n", encoding="utf-8")
    assert read_known_parts(path) == {"K1": True, "K2": False}


def test_about_half_of_the_simulated_parts_are_bad() -> None:
    parts = known_parts(SimulatedParts(), 100, 256)
    assert 30 <= sum(not part.is_good for part in parts) <= 60
    assert parts == known_parts(SimulatedParts(), 100, 256)


@pytest.mark.slow
def test_the_command_presents_parts_of_the_simulated_rig(
    station: Path, small_rig: Path, ps4rig: Callable[..., Any]
) -> None:
    assert small_rig
    result = ps4rig("station", "gauge", station, "--parts", 4, "--times", 2, "--json")
    found = json.loads(result.stdout)
    assert found["presentations"] == 8
    assert not any("ERROR" in line for line in found["wrong"])
    assert result.exit_code == (found["rating"] != "acceptable")
