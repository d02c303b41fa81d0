"""Corrections of sets by `ps4rig info --set` are judged again, wherever the session shows them."""

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.session.folder import SessionFolder
from capture.session.report_analysis import analyse

Command = Callable[..., Any]
# Both textures determine their orientation.
PLAN = """
name = "placed"
orientations_deg = [0, 40]
specimen = [{id = "rock-1", label = "rock", surface = "rock"}, {id = "sand-1", surface = "sand"}]
"""


@pytest.fixture
def placed(captured_session: Callable[[str], Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(captured_session(PLAN), tmp_path / "placed"))


def row_of(session: Path, file: str) -> dict[str, str]:
    rows = csv.DictReader((session / "sets.csv").open(encoding="utf-8", newline=""))
    return next(row for row in rows if row["file"] == file)


def warnings_of(session: Path) -> dict[str, tuple[str, ...]]:
    entries = SessionFolder(session).journal.entries
    return {str(each.file): each.measures.warnings for each in entries if each.measures}


@pytest.mark.parametrize(
    ("entered_deg", "warns"), [("130", True), ("0", True), ("80", True), ("220", False)]
)
def test_an_orientation_is_judged_again_when_it_is_corrected(
    ps4rig: Command, placed: Path, entered_deg: str, warns: bool
) -> None:
    file = "sets/rock-1-40-1.ome.tif"
    for value, judged in ((entered_deg, warns), ("40", False)):
        assert ps4rig("info", placed / file, "--set", f"orientation_deg={value}").exit_code == 0
        status = json.loads(ps4rig("session", "status", placed, "--json").stdout)["warned"]
        assert [each["file"] for each in status] == [file] * judged
        assert [each for each, _ in analyse(SessionFolder(placed)).remarks] == [file] * judged
        assert bool(row_of(placed, file)["warnings"]) == judged


def test_sets_are_judged_again_when_their_first_set_is_corrected(
    ps4rig: Command, placed: Path
) -> None:
    first, second = "sets/rock-1-0-1.ome.tif", "sets/rock-1-40-1.ome.tif"
    assert ps4rig("info", placed / first, "--set", "orientation_deg=70").exit_code == 0
    assert row_of(placed, second)["warnings"].startswith("the texture stands at ")
    assert abs(float(row_of(placed, second)["estimated_deg"]) - 110.0) < 2.0
    # Without the orientation of the first set there is nothing to compare with.
    assert ps4rig("info", placed / first, "--set", "orientation_deg=").exit_code == 0
    assert (row_of(placed, second)["estimated_deg"], warnings_of(placed)[second]) == ("", ())


def test_sets_are_judged_again_when_their_specimen_is_corrected(
    ps4rig: Command, placed: Path
) -> None:
    """A set of the wrong specimen belongs to the right one, also in the report."""
    wrong, right = placed / "sets" / "rock-1-40-1.ome.tif", placed / "sets" / "sand-1-40-1.ome.tif"
    for path, name in ((wrong, "sand-1"), (right, "rock-1")):
        assert ps4rig("info", path, "--set", f"specimen={name}").exit_code == 0
    said = [remark for _, remark in analyse(SessionFolder(placed)).remarks]
    assert any(each.startswith("looks more like rock-1") for each in said)
    for path, name in ((wrong, "rock-1"), (right, "sand-1")):
        assert ps4rig("info", path, "--set", f"specimen={name}").exit_code == 0
    assert analyse(SessionFolder(placed)).remarks == []


def test_a_damaged_set_keeps_no_correction_of_another_from_being_judged(
    ps4rig: Command, placed: Path
) -> None:
    first = placed / "sets" / "rock-1-0-1.ome.tif"
    first.write_bytes(first.read_bytes()[:-1000])
    second = placed / "sets" / "rock-1-40-1.ome.tif"
    assert ps4rig("info", second, "--set", "orientation_deg=60").exit_code == 0
    assert row_of(placed, "sets/rock-1-40-1.ome.tif")["orientation_deg"] == "60"
