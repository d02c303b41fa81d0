"""sets.csv: one value a column, with the values of the sets, for pandas, R and spreadsheets."""

import csv
import io
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from capture import CapturedSet
from capture.session.events import without_questions
from capture.session.folder import SessionFolder, make_session, session_folder
from capture.session.plan_change import use_plan
from capture.session.runner import run_session
from rig import RigConfig

NOTE = 'edge "worn", 5 \u00b5m; see p. 3'
PLAN = f"""
name = "table"
operator = "J. Wu"
orientations_deg = [0, 12.3456789, -40]
exposure_ms = 12.5
specimen = [
  {{id = "sand-1", surface = "sand"}},
  {{id = "rock-1", label = "rock", surface = "rock", note = '{NOTE}'}},
]
"""


@pytest.fixture(scope="module")
def captured_session(tmp_path_factory: pytest.TempPathFactory, config: RigConfig) -> Path:
    plan = tmp_path_factory.mktemp("table") / "table.toml"
    plan.write_text(PLAN, encoding="utf-8")
    with session_folder(make_session(plan)) as session:
        run_session(session, config, without_questions, lambda _: None)
        return session.path


@pytest.fixture
def table(captured_session: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(captured_session, tmp_path / "table"))


def rows_of(session: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((session / "sets.csv").open(encoding="utf-8", newline="")))


def test_each_value_is_that_of_the_set(table: Path) -> None:
    rows = rows_of(table)
    assert [row["specimen"] for row in rows] == ["sand-1"] * 3 + ["rock-1"] * 3
    for row in rows:
        captured = CapturedSet.load(table / row["file"])
        about = captured.metadata
        assert row["label"] == about.label
        assert row["operator"] == about.operator == "J. Wu"
        assert row["note"] == (about.note or "")
        assert row["calibration"] == ""
        assert float(row["exposure_ms"]) == about.camera.exposure_ms == 12.5
        assert float(row["orientation_deg"]) == about.orientation_deg
        assert row["captured_utc"] == about.created_utc
        assert row["pixels_sha256"] == about.pixels_sha256
        assert (row["planned"], row["state"], row["error"]) == ("true", "captured", "")
        for light, image in enumerate(captured.images):
            level = (image.mean() - captured.ambient.mean()) / about.full_scale
            assert float(row[f"level_led_{light}"]) == pytest.approx(level, abs=1e-6)
    assert rows[5]["note"] == NOTE
    assert [row["orientation_deg"] for row in rows[:3]] == ["0", "12.3456789", "-40"]


def test_the_table_is_plain_csv(table: Path) -> None:
    text = (table / "sets.csv").read_bytes()
    assert not text.startswith(b"\xef\xbb\xbf")
    lines = text.decode("utf-8").split("\r\n")
    assert "\n" not in "".join(lines)
    assert lines[-1] == ""
    header, *rows = csv.reader(io.StringIO(text.decode("utf-8"), newline=""), strict=True)
    assert len({*header}) == len(header)
    assert {len(row) for row in rows} == {len(header)}
    assert all(re.fullmatch(r"[a-z0-9_]+", name) for name in header)
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(table / "sets.csv")
    numbers = ["orientation_deg", "exposure_ms", "saturated_share", "level_led_0", "level_led_3"]
    assert all(np.issubdtype(frame[name].dtype, np.number) for name in numbers)
    assert frame["planned"].dtype == bool


def test_the_order_is_that_of_the_plan_whatever_is_captured_last(
    table: Path, config: RigConfig
) -> None:
    before = rows_of(table)
    plan = table.with_name("new.toml")
    plan.write_text(PLAN.replace("[0, 12.3456789, -40]", "[0]"), encoding="utf-8")
    with session_folder(table) as session:
        (table / before[0]["file"]).unlink()
        session.write_table()
        assert rows_of(table)[0]["state"] == "missing"
        run_session(session, config, without_questions, lambda _: None)
        assert [row["file"] for row in rows_of(table)] == [row["file"] for row in before]
        use_plan(plan, session)
    rows = rows_of(table)
    assert [(row["specimen"], row["orientation_deg"], row["planned"]) for row in rows] == [
        ("sand-1", "0", "true"), ("rock-1", "0", "true"),
        ("rock-1", "-40", "false"), ("rock-1", "12.3456789", "false"),
        ("sand-1", "-40", "false"), ("sand-1", "12.3456789", "false"),
    ]  # fmt: skip
    assert len(SessionFolder(table).unplanned()) == 4
