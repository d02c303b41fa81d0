"""Properties of a specimen: from the plan into sets, table, report and `info`."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture import CapturedSet
from capture.session.plan import read_plan

Command = Callable[..., Any]
Refused = Callable[..., str]
RIG = '[lights]\nport = "simulated"\n[camera]\nwidth_px = 64\nheight_px = 64\n'
PLAN = """
name = "stones"
orientations_deg = [0]

[[specimen]]
id = "rock-1"
surface = "rock"
[specimen.properties]
mass_g = 12.5
count = 3
whole = 5.0
polished = true
batch = "007"
made = 2026-05-17
at = 2026-05-17T08:30:00Z
"thickness (\u00b5m)" = 80
label = "a < b"
property_label = "c"

[[specimen]]
id = "sand-1"
surface = "sand"
"""
PROPERTIES = {
    "mass_g": 12.5, "count": 3, "whole": 5.0, "polished": True, "batch": "007",
    "made": "2026-05-17", "at": "2026-05-17T08:30:00+00:00", "thickness (\u00b5m)": 80,
    "label": "a < b", "property_label": "c",
}  # fmt: skip


@pytest.fixture
def plan(in_folder: Path) -> Path:
    (in_folder / "rig.toml").write_text(RIG)
    path = in_folder / "stones.toml"
    path.write_text(PLAN, encoding="utf-8")
    return path


def rows() -> list[dict[str, str]]:
    return list(csv.DictReader(Path("stones/sets.csv").open(encoding="utf-8", newline="")))


def test_properties_go_from_the_plan_to_everything(ps4rig: Command, plan: Path) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    path = Path("stones/sets/rock-1-0-1.ome.tif")
    found = CapturedSet.load(path).metadata.properties
    assert found == PROPERTIES
    assert [type(each) for each in found.values()] == [type(each) for each in PROPERTIES.values()]
    rock, sand = rows()
    shown = {"mass_g": "12.5", "count": "3", "whole": "5", "polished": "true", "batch": "007",
             "made": "2026-05-17", "at": "2026-05-17T08:30:00+00:00", "thickness (\u00b5m)": "80",
             "property_label": "a < b", "property_property_label": "c",
             "label": "rock-1"}  # fmt: skip
    assert {name: rock[name] for name in shown} == shown
    assert {sand[name] for name in shown} - {"", "sand-1"} == set()
    (answer,) = json.loads(ps4rig("info", path, "--json").stdout)
    assert answer["properties"] == PROPERTIES
    lines = ps4rig("info", path).stdout.splitlines()
    assert {f"  property       {each}" for each in ("mass_g = 12.5", "polished = true")} < {*lines}
    assert ps4rig("session", "report", "stones").exit_code == 0
    page = Path("stones/report.html").read_text()
    assert "mass_g = 12.5, count = 3, whole = 5, polished = true" in page
    assert "a &lt; b" in page


CORRECTIONS = {
    "batch=8": ("8", "8"),
    "polished=False": (False, "false"),
    "owner=J. Wu": ("J. Wu", "J. Wu"),
    "mass_g=13": (13, "13"),
    "mass_g=": (None, None),
}


def test_properties_are_corrected(ps4rig: Command, plan: Path) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    path, known = Path("stones/sets/rock-1-0-1.ome.tif"), dict(PROPERTIES)
    for correction, (value, cell) in CORRECTIONS.items():
        name = correction.split("=")[0]
        assert ps4rig("info", path, "--set", f"properties.{correction}").exit_code == 0
        metadata = CapturedSet.load(path).metadata
        assert metadata.properties.get(name) == value
        assert type(metadata.properties.get(name)) is type(value)
        entry = metadata.corrections[-1]
        said = (f"properties.{name}", known.get(name), value)
        assert (entry.field, entry.before, entry.after) == said
        assert rows()[0].get(name) == cell
        assert f"properties.{name}" in rows()[0]["corrected"]
        known[name] = value


@pytest.mark.slow
def test_the_report_shows_each_value_of_a_property(ps4rig: Command, plan: Path) -> None:
    plan.write_text(plan.read_text().replace("orientations_deg = [0]", "orientations_deg = [0, 9]"))
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    path = "stones/sets/rock-1-9-1.ome.tif"
    assert ps4rig("info", path, "--set", "properties.count=4").exit_code == 0
    assert ps4rig("session", "report", "stones").exit_code == 0
    assert "mass_g = 12.5, count = 3 or 4, whole = 5" in Path("stones/report.html").read_text()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("a = [1, 2]", "property a: [1, 2] "),
        ("a = {b = 1}", "property a: {'b': 1} "),
        ("a = nan", "property a: nan "),
        ("a = 9223372036854775808", "property a: 9223372036854775808 "),
        ('a = "' + "x" * 4001 + '"', "a: 4001 characters; up to 4000"),
        ('a = "x\\ty"', "use printable characters only"),
        ('"=1" = 1', "property '=1': "),
        ("\n".join(f"a{k} = {k}" for k in range(51)), "51 properties; up to 50"),
    ],
)
def test_a_property_that_no_set_could_hold_is_refused(
    refused: Refused, plan: Path, line: str, message: str
) -> None:
    text = plan.read_text(encoding="utf-8").replace("mass_g = 12.5", line)
    if "51" in message:
        text = text.split("count = 3")[0]
    plan.write_text(text, encoding="utf-8")
    said = refused("session", "run", plan, "--dry-run")
    assert message in said
    assert "stones.toml: specimen.0.properties" in said


def test_a_wrong_property_changes_nothing(ps4rig: Command, refused: Refused, plan: Path) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    path = Path("stones/sets/rock-1-0-1.ome.tif")
    before = path.read_bytes()
    for correction in ("properties.=1", "properties.mass_g=nan", "mass_g=3"):
        assert refused("info", path, "--set", correction)
    assert path.read_bytes() == before
    assert len(read_plan(plan)) == 2
