"""The command info, and corrections of a set."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture import CapturedSet
from capture.sets.metadata import ImageRecord
from rig.set_file import SCHEMA_VERSION

Command = Callable[..., Any]
Refused = Callable[..., str]
DATA = Path(__file__).parents[2] / "data" / "sets"


@pytest.fixture
def captured(ps4rig: Command, tmp_path: Path) -> Path:
    path = tmp_path / "a.ome.tif"
    result = ps4rig(
        "capture", "--rig", "sim", "--size", 64, "--rotate", 20, "--label", "oak",
        "--specimen", "oak-07", "--operator", "J. Wu", "--note", "edge worn", path,
    )  # fmt: skip
    assert result.exit_code == 0
    return path


def test_info_shows_where_a_set_comes_from(ps4rig: Command, captured: Path) -> None:
    lines = ps4rig("info", captured).stdout.splitlines()
    assert lines[0] == str(captured)
    said = dict(line.split(maxsplit=1) for line in lines[1:])
    assert said["label"] == "oak"
    assert said["specimen"] == "oak-07"
    assert said["operator"] == "J. Wu"
    assert said["note"] == "edge worn"
    assert said["orientation"] == "20 degrees"
    assert said["captured"].endswith("(simulated)")
    assert said["controller"].startswith("LED4 SIM-0001")
    assert said["calibration"] == "none"
    assert said["pixels"] == f"SHA-256 {CapturedSet.load(captured).metadata.pixels_sha256}"


def test_a_correction_is_a_dated_entry_and_changes_no_pixel(
    ps4rig: Command, captured: Path
) -> None:
    before = CapturedSet.load(captured)
    result = ps4rig(
        "info", captured, "--set", "orientation_deg=40", "--set", "note= = left edge worn",
        "--set", "specimen=", "--set", "operator=J. Wu", "--json",
    )  # fmt: skip
    (answer,) = json.loads(result.stdout)
    after = CapturedSet.load(captured)
    np.testing.assert_array_equal(after.images, before.images)
    assert after.metadata.pixels_sha256 == before.metadata.pixels_sha256
    assert (after.metadata.orientation_deg, after.metadata.note) == (40.0, "= left edge worn")
    assert after.metadata.specimen is None
    entries = [(each.field, each.before, each.after) for each in after.metadata.corrections]
    # The operator was right already.
    assert entries == [
        ("orientation_deg", 20.0, 40.0),
        ("note", "edge worn", "= left edge worn"),
        ("specimen", "oak-07", None),
    ]
    assert answer["corrections"][0]["before"] == 20.0
    assert ps4rig("info", captured, "--set", "label=elm").exit_code == 0
    assert CapturedSet.load(captured).label == "elm"
    assert len(CapturedSet.load(captured).metadata.corrections) == 4


@pytest.mark.parametrize(("degrees", "is_warned"), [(1200, True), (-361, True), (360, False)])
def test_an_orientation_beyond_a_circle_is_a_warning(
    ps4rig: Command, captured: Path, degrees: int, is_warned: bool
) -> None:
    result = ps4rig("info", captured, "--set", f"orientation_deg={degrees}")
    assert result.exit_code == 0
    assert (f"warning: orientation_deg {degrees}: " in result.stderr) == is_warned
    assert CapturedSet.load(captured).metadata.orientation_deg == degrees


@pytest.mark.parametrize(
    ("correction", "message"),
    [
        ("note", "--set note: give FIELD=VALUE"),
        ("gamma=srgb", "gamma: cannot be corrected"),
        ("label=Unknown", "label 'Unknown': "),
        ("orientation_deg=north", "orientation_deg north: give degrees"),
        ("orientation_deg=4_0", "orientation_deg 4_0: give degrees"),
        (f"note={'a' * 4001}", "note: 4001 characters; up to 4000"),
    ],
)
def test_a_wrong_correction_changes_nothing(
    refused: Refused, captured: Path, correction: str, message: str
) -> None:
    before = captured.read_bytes()
    assert message in refused("info", captured, "--set", correction)
    assert captured.read_bytes() == before


def test_no_set_is_corrected_if_one_of_them_cannot_be(
    refused: Refused, captured: Path, tmp_path: Path
) -> None:
    whole, before = (DATA / "rock.ome.tif").read_bytes(), captured.read_bytes()
    (tmp_path / "cut.ome.tif").write_bytes(whole[: len(whole) // 2])
    assert f"{tmp_path / 'cut.ome.tif'}: " in refused("info", tmp_path, "--set", "note=left")
    assert captured.read_bytes() == before


def test_an_imported_set_names_its_photographs(
    ps4rig: Command, made_set: Command, tmp_path: Path
) -> None:
    names = ("image6.png", "image0.png", "image2.png", "image4.png")
    records = tuple(ImageRecord(light=k, source_file=name) for k, name in enumerate(names))
    made_set(np.full((4, 8, 9), 900, np.uint16), images=records).save(tmp_path / "a.ome.tif")
    said = ps4rig("info", tmp_path / "a.ome.tif").stdout
    assert "image6.png, image0.png" in said
    assert f"schema {SCHEMA_VERSION}" in said
