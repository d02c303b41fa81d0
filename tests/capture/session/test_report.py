"""The report of a session: its findings and its page."""

import csv
import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture import CapturedSet
from capture.session.folder import session_folder
from capture.session.report_analysis import analyse
from capture.session.report_page import report_page

Command = Callable[..., Any]
PLAN = """
name = "mixed"
operator = "<b>J. Wu</b>"
orientations_deg = [0, 40]
specimen = [
  {id = "rock-1", label = "rock", surface = "rock", note = "a < b"},
  {id = "sand-1", surface = "sand"},
  {id = "bark-1", surface = "Bark014"},
]
"""


@pytest.fixture
def mixed(captured_session: Callable[[str], Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(captured_session(PLAN), tmp_path / "mixed"))


def test_textures_separate_and_nothing_stands_out(mixed: Path) -> None:
    with session_folder(mixed) as session:
        found = analyse(session)
    assert found.remarks == []
    assert [entry.file for entry in found.entries][:2] == [
        "sets/rock-1-0-1.ome.tif", "sets/rock-1-40-1.ome.tif",
    ]  # fmt: skip
    separation = found.separation
    assert separation.specimens == ["rock-1", "sand-1", "bark-1"]
    # Each second set is nearest to the first of its specimen.
    for row, entry in zip(separation.distances, separation.entries, strict=True):
        if entry.orientation_deg > 0.0:
            assert row.argmin() == separation.specimens.index(entry.specimen)
    assert sorted(separation.tree.order) == [0, 1, 2]


def test_a_set_of_another_specimen_stands_out(mixed: Path) -> None:
    with session_folder(mixed) as session:
        entry = session.journal.entries[1]
        wrong = CapturedSet.load(mixed / "sets" / "sand-1-40-1.ome.tif")
        about = wrong.metadata.model_copy(update={"specimen": "rock-1", "orientation_deg": 40.0})
        CapturedSet(wrong.images, wrong.ambient, about).save(mixed / str(entry.file))
        session.update(
            session.journal.with_entry(
                entry.model_copy(update={"pixels_sha256": about.pixels_sha256})
            )
        )
        remarks = analyse(session).remarks
    said = dict(remarks)["sets/rock-1-40-1.ome.tif"]
    assert said.startswith("looks more like sand-1")
    assert any(said.startswith("has the pixels of") for _, said in remarks)


@pytest.mark.parametrize("damaged", ["rock-1-0-1", "sand-1-40-1"])
def test_a_damaged_set_is_named_and_the_others_are_reported(
    mixed: Path, ps4rig: Command, damaged: str
) -> None:
    file = f"sets/{damaged}.ome.tif"
    (mixed / file).write_bytes((mixed / file).read_bytes()[:-1000])
    result = ps4rig("session", "report", mixed, "--json")
    assert result.exit_code == 0
    answer = json.loads(result.stdout)
    ((name, error),) = ((each["set"], each["error"]) for each in answer["damaged"])
    assert (name, answer["sets"], answer["remarks"]) == (file, 5, [])
    assert error
    page = (mixed / "report.html").read_text()
    assert f"<td>{file}</td><td>cannot be read" in page
    assert "1 of the captured ones" in page
    # The other set of the specimen takes the place of a damaged first one.
    assert page.count("<h3>") == 3
    rows = {row["file"]: row for row in csv.DictReader((mixed / "sets.csv").open(newline=""))}
    assert (rows[file]["state"], rows[file]["error"]) == ("damaged", error)
    assert {row["state"] for row in rows.values()} == {"captured", "damaged"}


def test_an_exchanged_set_is_not_reported_as_the_captured_one(mixed: Path) -> None:
    path = mixed / "sets" / "rock-1-40-1.ome.tif"
    shutil.copy(path.with_name("sand-1-0-1.ome.tif"), path)
    with session_folder(mixed) as session:
        found = analyse(session)
    assert len(found.entries) == 5
    ((file, error),) = found.damaged.items()
    assert file == "sets/rock-1-40-1.ome.tif"
    assert "its pixels" in error


def test_a_session_of_damaged_sets_is_reported(mixed: Path) -> None:
    for path in (mixed / "sets").iterdir():
        path.write_bytes(b"")
    with session_folder(mixed) as session:
        found = analyse(session)
        assert len(found.damaged) == 6
        assert report_page(session, found).count("<td>cannot be read") == 6


def test_training_on_a_session_leaves_out_what_it_set_aside(
    mixed: Path, ps4rig: Command, tmp_path: Path
) -> None:
    damaged = mixed / "sets" / "rock-1-40-1.ome.tif"
    (mixed / "replaced").mkdir()
    damaged.write_bytes(b"")
    damaged.rename(mixed / "replaced" / "20260101T000000-rock-1-40-1.ome.tif")
    library = tmp_path / "mixed.ps4lib"
    assert ps4rig("train", mixed, "--library", library).exit_code == 0
    answer = json.loads(ps4rig("classify", mixed, "--library", library, "--json").stdout)
    assert len(answer) == 5


def test_the_page_escapes_what_people_wrote(mixed: Path) -> None:
    with session_folder(mixed) as session:
        page = report_page(session, analyse(session))
    assert "&lt;b&gt;J. Wu&lt;/b&gt;" in page
    assert "<b>J. Wu" not in page
    assert "a &lt; b" in page
    assert page.count('alt="light 0: tilt 0"') == 3
    assert page.count("polar spectra of gradient") == 3
    assert "\u22120<" not in page
    assert "<script" not in page


def test_one_specimen_is_reported_without_a_comparison(mixed: Path) -> None:
    plan = mixed / "plan.toml"
    lines = [line for line in PLAN.splitlines() if "sand-1" not in line and "bark-1" not in line]
    plan.write_text("\n".join(lines))
    with session_folder(mixed) as session:
        kept = [each for each in session.journal.entries if each.specimen == "rock-1"]
        session.update(session.journal.model_copy(update={"entries": tuple(kept)}))
        found = analyse(session)
        assert found.separation is None
        assert "It takes two specimens" in report_page(session, found)


@pytest.mark.slow
def test_a_session_without_sets_or_of_two_rigs_is_reported(mixed: Path) -> None:
    with session_folder(mixed) as session:
        entries = session.journal.entries
        session.update(session.journal.model_copy(update={"entries": ()}))
        with warnings.catch_warnings(action="error"):
            report_page(session, analyse(session))
        last = entries[-1]
        eight = last.measures.model_copy(update={"led_levels": (0.4,) * 8})
        changed = (*entries[:-1], last.model_copy(update={"measures": eight}))
        session.update(session.journal.model_copy(update={"entries": changed}))
        assert report_page(session, analyse(session)).startswith("<!DOCTYPE html>")


def test_the_command_writes_the_page_and_names_what_stands_out(
    mixed: Path, ps4rig: Command, in_folder: Path
) -> None:
    result = ps4rig("session", "report", mixed)
    assert (result.exit_code, result.stdout) == (0, f"{mixed / 'report.html'}: 6 sets\n")
    assert (mixed / "report.html").read_text().startswith("<!DOCTYPE html>")
    answer = json.loads(ps4rig("session", "report", mixed, "--json").stdout)
    report = str(mixed / "report.html")
    assert answer == {"report": report, "sets": 6, "damaged": [], "remarks": []}
    assert ps4rig("session", "report", in_folder).exit_code == 2


REPEATED = """
name = "repeated"
operator = "J. Wu"
orientations_deg = [0]
repeats = 2
specimen = [{id = "rock-1", surface = "rock"}]
"""


def test_repeats_differ_by_the_deviation_that_is_stated(
    captured_session: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(captured_session(REPEATED), tmp_path / "repeated"))
    with session_folder(folder) as session:
        found = analyse(session)
        page = report_page(session, found)
    (row,) = found.repeatability
    assert row.specimen == "rock-1"
    assert 0.9 < row.measured / row.stated < 1.1
    assert "Repeatability" in page
