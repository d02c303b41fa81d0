"""The commands session new, run, status and resume."""

import csv
import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from capture.commands import session_run
from capture.commands.session_terminal import line_of
from capture.session.folder import session_folder
from capture.session.journal import SetEntry, SetMeasures

Command = Callable[..., Any]
Refused = Callable[..., str]
RIG = '[lights]\nport = "simulated"\n[camera]\nwidth_px = 96\nheight_px = 96\n'


@pytest.fixture
def rig(in_folder: Path) -> Path:
    path = in_folder / "rig.toml"
    path.write_text(RIG)
    return path


@pytest.fixture
def plan(ps4rig: Command, rig: Path) -> Path:
    path = rig.parent / "fabrics.toml"
    assert ps4rig("session", "new", path).exit_code == 0
    text = path.read_text().replace("[0, 30, 60, 90, 120, 150]", "[0, 30]")
    path.write_text(text)
    return path


def test_new_never_replaces_a_plan(refused: Refused, plan: Path) -> None:
    before = plan.read_text()
    assert "exists already" in refused("session", "new", plan)
    assert "must end in .toml" in refused("session", "new", plan.with_suffix(".txt"))
    assert plan.read_text() == before


def test_a_plan_whose_file_cannot_name_a_session_is_not_written(
    refused: Refused, in_folder: Path
) -> None:
    assert "'my plan'" in refused("session", "new", "my plan.toml")
    assert not list(in_folder.iterdir())


def test_a_dry_run_shows_the_plan_and_captures_nothing(ps4rig: Command, plan: Path) -> None:
    said = ps4rig("session", "run", plan, "--dry-run").stdout
    assert "rock-1: class rock" in said
    assert "each at 0, 30 degrees" in said
    assert "4 sets, 2 s of capture" in said
    answer = json.loads(ps4rig("session", "run", plan, "--dry-run", "--json").stdout)
    assert answer["sets"] == 4
    # Five images of 16 bits.
    assert 4 * 2 * 5 * 96**2 <= answer["bytes"] < 4 * 2 * 5 * 96**2 + 100_000
    assert not (plan.parent / "fabrics").exists()
    plan.write_text(plan.read_text().replace("[0, 30]", "[0, 1200]"))
    assert "orientations_deg 1200: " in ps4rig("session", "run", plan, "--dry-run").stderr


@pytest.mark.parametrize("option", ["--dry-run", "--yes"])
def test_an_exposure_without_dark_frames_is_refused_at_the_start(
    ps4rig: Command, refused: Refused, plan: Path, rig: Path, option: str
) -> None:
    assert ps4rig("calibrate", "dark", "--rig", rig, "rig.ps4cal").exit_code == 0
    rig.write_text('calibration = "rig.ps4cal"\n' + RIG)
    text = plan.read_text()
    plan.write_text("exposure_ms = 12\n" + text)
    line = refused("session", "run", plan, option)
    assert "exposure_ms = 12" in line
    assert "set camera.exposure_ms = 12" in line
    plan.write_text(text)
    rig.write_text(rig.read_text() + "exposure_ms = 12\n")
    assert "exposure_ms = 12" in refused("session", "run", plan, option)
    rig.write_text('calibration = "rig.ps4cal"\n' + RIG.replace("96", "64"))
    line = refused("session", "run", plan, option)
    assert line.startswith("rig.ps4cal: ")
    assert not (plan.parent / "fabrics").exists()


def test_a_search_beyond_the_dark_frames_is_announced(
    ps4rig: Command, plan: Path, rig: Path
) -> None:
    plan.write_text('exposure_ms = "search"\n' + plan.read_text())
    for exposure_ms, measured in ((20, "at 20 ms only"), (5, "from 5 to 20 ms")):
        rig.write_text(f"{RIG}exposure_ms = {exposure_ms}\n")
        assert ps4rig("calibrate", "dark", "--rig", rig, "rig.ps4cal").exit_code == 0
        rig.write_text('calibration = "rig.ps4cal"\n' + RIG)
        done = ps4rig("session", "run", plan, "--dry-run")
        assert done.exit_code == 0
        assert f"dark frames were measured {measured} (" in done.stderr
        assert "at other exposures" in done.stderr


def test_a_disk_that_is_too_small_is_refused(ps4rig: Command, refused: Refused, plan: Path) -> None:
    plan.write_text(plan.read_text().replace("[0, 30]", str([each / 10 for each in range(3600)])))
    (plan.parent / "rig.toml").write_text(RIG.replace("96", "8192"))
    dry = ps4rig("session", "run", plan, "--dry-run")
    assert dry.exit_code == 2
    assert "7200 sets" in dry.stdout
    assert "plan fewer sets" in dry.stderr
    assert "plan fewer sets" in refused("session", "run", plan, "--yes")
    assert not (plan.parent / "fabrics").exists()


def test_a_session_runs_to_its_end_and_says_so(ps4rig: Command, plan: Path) -> None:
    result = ps4rig("session", "run", plan, "--yes")
    assert result.exit_code == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[1].startswith("sets/rock-1-30-1.ome.tif: levels 4")
    assert "at 30." in lines[1] or "at 29." in lines[1]
    assert lines[-1].startswith("complete: 4 sets captured")
    log = (plan.parent / "fabrics" / "session.log").read_text()
    assert all(line in log for line in lines)
    status = ps4rig("session", "status", "fabrics").stdout
    assert "4 captured, 0 left out, 0 missing" in status
    answer = json.loads(ps4rig("session", "resume", "fabrics", "--yes", "--json").stdout)
    assert answer == {
        "session": "fabrics", "finish": "complete", "captured": 0, "missing": 0, "left_out": 0,
    }  # fmt: skip


def test_a_set_that_cannot_be_read_for_a_moment_is_not_missing(
    ps4rig: Command, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0

    def fails(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("tifffile.TiffPage.asarray", fails)
    answer = json.loads(ps4rig("session", "status", "fabrics", "--json").stdout)
    assert (answer["missing"], answer["damaged"], len(answer["unreadable"])) == ([], [], 4)
    assert "may be intact" in answer["unreadable"][0]["reason"]
    assert "(not enough memory)" in ps4rig("session", "status", "fabrics").stdout


def test_a_damaged_set_is_named_and_captured_by_resume(ps4rig: Command, plan: Path) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    path = plan.parent / "fabrics" / "sets" / "sand-1-0-1.ome.tif"
    path.write_bytes(path.read_bytes()[:-1000])
    answer = json.loads(ps4rig("session", "status", "fabrics", "--json").stdout)
    which = {"specimen": "sand-1", "orientation_deg": 0.0, "repeat": 1}
    assert answer["missing"] == [which]
    (damaged,) = answer["damaged"]
    assert damaged.pop("reason")
    assert damaged == which
    assert "sand-1 at 0 degrees" in ps4rig("session", "status", "fabrics").stdout
    result = ps4rig("session", "resume", "fabrics", "--yes")
    assert (result.exit_code, "sand-1 at 0 degrees" in result.stdout) == (0, True)


def test_a_correction_of_a_set_is_in_the_table_of_its_session(
    ps4rig: Command, refused: Refused, plan: Path
) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    folder = plan.parent / "fabrics"
    path = folder / "sets" / "rock-1-30-1.ome.tif"
    options = ("--set", "orientation_deg=60", "--set", "note=", "--set", "label=slate")

    def row() -> dict[str, str]:
        rows = csv.DictReader((folder / "sets.csv").open(encoding="utf-8", newline=""))
        return next(row for row in rows if row["file"] == f"sets/{path.name}")

    with session_folder(folder):
        assert "in use by" in refused("info", path, *options)
    assert row()["label"] == "rock"
    assert ps4rig("info", path, *options).exit_code == 0
    corrected = row()
    assert (corrected["label"], corrected["orientation_deg"]) == ("slate", "60")
    assert corrected["corrected"] == "orientation_deg label"
    assert abs(float(corrected["estimated_deg"]) - 30.0) < 2.0
    assert "30 degrees, 60 were entered" in corrected["warnings"]
    assert ps4rig("verify", folder).exit_code == 0
    # The journal can be made again, and names the set as it was planned.
    (folder / "journal.json").unlink()
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    assert row() == corrected
    assert not (folder / "replaced").exists()


def test_a_correction_that_the_table_missed_is_entered_by_the_next_run(
    ps4rig: Command, plan: Path, tmp_path: Path
) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    path = plan.parent / "fabrics" / "sets" / "rock-1-30-1.ome.tif"
    elsewhere = tmp_path / path.name
    path.rename(elsewhere)
    assert ps4rig("info", elsewhere, "--set", "label=slate").exit_code == 0
    elsewhere.rename(path)
    table = plan.parent / "fabrics" / "sets.csv"
    assert "slate" not in table.read_text()
    assert ps4rig("session", "resume", "fabrics", "--yes").exit_code == 0
    assert "rock-1,slate,30,1,true,captured" in table.read_text()


def test_a_dry_run_of_a_session_counts_what_is_missing(ps4rig: Command, plan: Path) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    plan.write_text(plan.read_text().replace("[0, 30]", "[0, 30, 60]"))
    (plan.parent / "fabrics" / "sets" / "sand-1-30-1.ome.tif").unlink()
    said = ps4rig("session", "run", plan, "--dry-run").stdout
    assert "6 sets planned, 3 missing" in said
    answer = json.loads(ps4rig("session", "run", plan, "--dry-run", "--json").stdout)
    assert (answer["sets"], answer["missing"]) == (6, 3)
    assert 3 * 2 * 5 * 96**2 <= answer["bytes"] < 3 * 2 * 5 * 96**2 + 100_000


def test_a_changed_plan_needs_a_confirmation(ps4rig: Command, plan: Path) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    plan.write_text(plan.read_text().replace("[0, 30]", "[0, 30, 60]"))
    result = ps4rig("session", "run", plan, "--yes")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "give --new-plan" in result.stderr
    assert "[0, 30]" in (plan.parent / "fabrics" / "plan.toml").read_text()


def test_without_a_terminal_nobody_is_asked(refused: Refused, plan: Path) -> None:
    assert "give --yes" in refused("session", "run", plan)
    assert "folder of a session" in refused("session", "status", plan.parent)
    assert "folder of a session" in refused("session", "resume", plan.parent, "--yes")


def test_a_session_without_its_journal_names_the_command_that_makes_it(
    ps4rig: Command, refused: Refused, plan: Path
) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    (plan.parent / "fabrics" / "journal.json").unlink()
    for command in (("status",), ("resume", "--yes")):
        message = refused("session", *command, plan.parent / "fabrics")
        assert "journal.json is missing; ps4rig session run PLAN" in message
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    assert ps4rig("session", "status", plan.parent / "fabrics").exit_code == 0


def test_a_run_needs_room_for_the_missing_sets_only(
    ps4rig: Command, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    monkeypatch.setattr(
        session_run, "shutil", SimpleNamespace(disk_usage=lambda _: SimpleNamespace(free=0))
    )
    result = ps4rig("session", "run", plan, "--yes")
    assert result.exit_code == 0, result.stderr


def test_the_line_of_a_set_has_no_negative_zero() -> None:
    measures = SetMeasures(
        led_levels=(0.5,), saturated=0.0, shadowed=0.0, estimated_deg=-0.013, blur_px=0.01
    )
    entry = SetEntry(specimen="a", orientation_deg=0, repeat=1, file="a", measures=measures)
    assert line_of(entry).endswith("at 0.0 degrees, focus +0.0 px")


def test_status_counts_planned_sets_whose_file_is_there(ps4rig: Command, plan: Path) -> None:
    assert ps4rig("session", "run", plan, "--yes").exit_code == 0
    folder = plan.parent / "fabrics"
    (folder / "sets" / "rock-1-30-1.ome.tif").unlink()
    said = ps4rig("session", "status", "fabrics").stdout.split()
    assert said[said.index("rock-1") :][:3] == ["rock-1", "1", "30"]
    with session_folder(folder) as opened:
        gone = SetEntry(specimen="wood-1", orientation_deg=0.0, repeat=1, skipped="wet")
        opened.update(opened.journal.with_entry(gone))
    assert "3 captured, 0 left out, 1 missing" in ps4rig(
        "session", "status", "fabrics"
    ).stdout.replace("\n", " ")


@pytest.mark.slow
def test_an_operator_answers_on_a_terminal(
    spawn: Callable[..., subprocess.Popen[str]], ps4rig: Command, plan: Path
) -> None:
    primary, secondary = os.openpty()
    try:
        # The first placement, a wrong key, once more, the second placement; then stop.
        os.write(primary, b"\nx\nr\n\nq\n")
        process = spawn("session", "run", plan, "--rig", plan.parent / "rig.toml", stdin=secondary)
        out, error = process.communicate(timeout=60)
    finally:
        os.close(primary)
        os.close(secondary)
    assert process.returncode == 1
    assert "each specimen should lie" in error.splitlines()[0]
    assert "rock-1, turn to 30 degrees" in error
    assert out.splitlines()[-1].startswith("stopped: 3 sets captured")
    assert len(list((plan.parent / "fabrics" / "replaced").iterdir())) == 1
    assert "2 missing" in ps4rig("session", "status", "fabrics").stdout


def test_a_plan_that_does_not_suit_the_rig_is_refused_before_a_folder_is_made(
    refused: Refused, plan: Path
) -> None:
    text = plan.read_text()
    plan.write_text(text.replace('surface = "rock"', 'surface = "rok"'))
    for option in ("--dry-run", "--yes"):
        assert "surface 'rok' is neither" in refused("session", "run", plan, option)
    plan.write_text("calibration_required = true\n" + text)
    assert "calibration_required, but" in refused("session", "run", plan, "--dry-run")
    assert not (plan.parent / "fabrics").exists()
