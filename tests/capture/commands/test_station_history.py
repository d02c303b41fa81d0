import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from capture.cli import app
from tests.capture.station.results.parts import record_three_days


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A station with five parts, one of them simulated and one overridden, and one begun."""
    folder = tmp_path / "line-1"
    CliRunner().invoke(app, ["station", "init", str(folder)])
    record_three_days(folder / "results.sqlite")
    return folder


@pytest.fixture
def station(folder: Path) -> Callable[..., Result]:
    def run(command: str, *arguments: str) -> Result:
        return CliRunner().invoke(app, ["station", command, str(folder), *arguments])

    return run


Station = Callable[..., Result]


def ids(station: Station, *options: str) -> list[str]:
    said = station("history", "--json", *options)
    assert said.exit_code == 0
    return [part["part_id"] for part in json.loads(said.stdout)["parts"]]


@pytest.mark.parametrize(
    ("options", "numbers"),
    [
        ([], [1, 2, 3, 4]),
        (["--include-simulated"], [1, 2, 3, 4, 5]),
        (["--since", "2026-11-21"], [4]),
        (["--since", "2026-11-20T08:01:00+00:00", "--until", "2026-11-20T09:02:30+01:00"], [2, 3]),
        (["--verdict", "pass"], [1, 2, 3]),
        (["--class", "oak", "--recipe", "ash"], []),
    ],
)
def test_options_select_parts(station: Station, options: list[str], numbers: list[int]) -> None:
    names = {3: "A-17"}
    assert ids(station, *options) == [names.get(each, f"part-{each:06d}") for each in numbers]


def test_the_table_counts_production_and_says_what_it_leaves_out(station: Station) -> None:
    said = station("history").stdout
    assert "parts 4: 3 PASS, 0 FAIL, 1 UNKNOWN" in said
    assert "before overrides 2 PASS, 1 FAIL" in said
    assert "simulated rig, left out: 1" in said
    assert "part-000005" not in said


def test_simulated_parts_are_marked_and_counted_apart(station: Station) -> None:
    said = station("history", "--include-simulated").stdout
    assert "parts 4: 3 PASS" in said
    assert "line-1, SIMULATED: parts 1: 1 PASS" in said
    assert "PASS SIMULATED" in said


def test_csv_without_parts_has_its_header(station: Station) -> None:
    assert station("history", "--csv", "--class", "ash").stdout.split(",")[:2] == [
        "station",
        "number",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["override", "A-17", "--verdict", "ERROR", "--by", "Jo", "--reason", "x"], "ERROR"),
        (["override", "A-17", "--verdict", "PASS", "--by", "", "--reason", "x"], "--by ''"),
        (["history", "--since", "yesterday"], "--since yesterday"),
        (["history", "--until", "0001-01-01T00:00+14:00"], "--until 0001"),
        (["history", "--json", "--csv"], "one of them"),
    ],
)
def test_an_impossible_request_is_one_line(
    station: Station, arguments: list[str], message: str
) -> None:
    said = station(*arguments)
    assert said.exit_code == 2
    assert message in said.stderr
    assert len(said.stderr.splitlines()) == 1
