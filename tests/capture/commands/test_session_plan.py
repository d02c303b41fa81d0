"""A plan or a rig that was edited between two runs, and sets that were left out."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.base.errors import SetRejected
from capture.session import runner
from capture.session.folder import SessionFolder, session_folder
from capture.session.journal import SetEntry

Command = Callable[..., Any]
Refused = Callable[..., str]
RIG = '[lights]\nport = "simulated"\n[camera]\nwidth_px = 64\nheight_px = 64\nexposure_ms = 20\n'
PLAN = """
name = "stones"
orientations_deg = [0, 30]
specimen = [{id = "rock-1", label = "rock", surface = "rock"}, {id = "sand-1", surface = "sand"}]
"""


@pytest.fixture
def plan(ps4rig: Command, in_folder: Path) -> Path:
    (in_folder / "rig.toml").write_text(RIG)
    path = in_folder / "any-name.toml"
    path.write_text(PLAN)
    assert ps4rig("session", "run", path, "--yes").exit_code == 0
    return path


def files() -> dict[str, str | None]:
    entries = SessionFolder(Path("stones")).journal.entries
    return {each.file: each.pixels_sha256 for each in entries if each.file}


def test_resume_says_that_the_plan_was_edited_and_keeps_the_old_one(
    ps4rig: Command, plan: Path
) -> None:
    plan.write_text(
        PLAN.replace("[0, 30]", "[0, 60]\nexposure_ms = 15").replace('"rock",', '"slate",')
        + "\n# comment"
    )
    done = ps4rig("session", "resume", "stones", "--yes", "--json")
    assert done.exit_code == 0
    assert json.loads(done.stdout)["captured"] == 0
    said = done.stderr
    assert "orientations_deg: [0.0, 30.0] -> [0.0, 60.0]" in said
    assert "exposure_ms: none -> 15.0" in said
    assert 'rock-1: label: "rock" -> "slate"' in said
    assert "kept: rock-1 at 30; sand-1 at 30" in said
    assert "resume stones --new-plan" in said
    assert len(SessionFolder(Path("stones")).missing()) == 0


@pytest.mark.parametrize(
    "command",
    [("resume", "stones"), pytest.param(("run", "any-name.toml"), marks=pytest.mark.slow)],
)
def test_a_new_plan_is_taken_without_a_terminal_and_no_set_is_lost(
    ps4rig: Command, plan: Path, command: tuple[str, str]
) -> None:
    before = files()
    plan.write_text(PLAN.replace("[0, 30]", "[0, 60]").replace('"sand-1"', '"sand-2"'))
    done = ps4rig("session", *command, "--yes", "--new-plan")
    assert done.exit_code == 0, done.stderr
    assert before.items() <= files().items()
    assert set(files()) - set(before) == {
        f"sets/{name}.ome.tif" for name in ("rock-1-60-1", "sand-2-0-1", "sand-2-60-1")
    }
    status = json.loads(ps4rig("session", "status", "stones", "--json").stdout)
    assert [(each["specimen"], each["orientation_deg"]) for each in status["unplanned"]] == [
        ("rock-1", 30.0), ("sand-1", 0.0), ("sand-1", 30.0),
    ]  # fmt: skip
    said = ps4rig("session", "status", "stones").stdout
    assert "kept: rock-1 at 30; sand-1 at 0, 30" in said
    # Nothing is said once the plan is taken.
    assert ps4rig("session", "resume", "stones", "--yes").stderr == ""
    page = json.loads(ps4rig("session", "report", "stones", "--json").stdout)
    assert page["sets"] == 7
    assert "class sand-1" in (plan.parent / "stones" / "report.html").read_text()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PLAN.replace("[0, 30]", "[]"), "any-name.toml: orientations_deg"),
        ("name = 'stones'\norientations_deg = [", None),
    ],
)
def test_an_edited_plan_that_cannot_be_used_is_named(
    ps4rig: Command, refused: Refused, plan: Path, text: str, message: str | None
) -> None:
    if message is None:  # without a name in it, the name of the file counts
        plan.unlink()
        plan, message = plan.with_name("stones.toml"), "stones.toml: "
    plan.write_text(text)
    done = ps4rig("session", "resume", "stones", "--yes")
    assert done.exit_code == 0
    assert message in done.stderr
    assert message in refused("session", "resume", "stones", "--yes", "--new-plan")


def test_two_plans_of_a_session_are_named(refused: Refused, ps4rig: Command, plan: Path) -> None:
    plan.with_name("copy.toml").write_text(PLAN.replace("[0, 30]", "[0]"))
    message = "any-name.toml, copy.toml: each is a plan of stones"
    assert message in ps4rig("session", "resume", "stones", "--yes").stderr
    assert message in refused("session", "resume", "stones", "--yes", "--new-plan")


def test_a_new_plan_that_is_not_there_is_an_error(
    refused: Refused, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan.unlink()
    monkeypatch.chdir("stones")
    options = ("--rig", "../rig.toml", "--yes", "--new-plan")
    assert "name = 'stones'" in refused("session", "resume", ".", *options)


def test_a_file_name_that_was_changed_loses_no_set(ps4rig: Command, plan: Path) -> None:
    plan.write_text(PLAN.replace("name =", 'file_name = "{specimen}_{angle}_{repeat}"\nname =', 1))
    before = files()
    assert ps4rig("session", "resume", "stones", "--yes", "--new-plan").exit_code == 0
    assert files() == before
    path = Path("stones", "sets", "rock-1-30-1.ome.tif")
    path.write_bytes(path.read_bytes()[:-1000])
    assert ps4rig("session", "resume", "stones", "--yes").exit_code == 0
    assert not path.exists()
    assert "sets/rock-1_30_1.ome.tif" in files()
    assert ps4rig("verify", "stones").exit_code == 0


def test_a_rig_that_was_changed_is_named(ps4rig: Command, plan: Path) -> None:
    Path("rig.toml").write_text(RIG.replace("exposure_ms = 20", "exposure_ms = 15"))
    line = "the rig differs from the last run: camera.exposure_ms: 20.0 -> 15.0"
    assert line in ps4rig("session", "resume", "stones", "--yes").stdout
    assert line in (plan.parent / "stones" / "session.log").read_text()
    assert "differs" not in ps4rig("session", "resume", "stones", "--yes").stdout


@pytest.mark.slow
def test_a_terminal_is_asked_whether_to_take_the_new_plan(spawn: Command, plan: Path) -> None:
    plan.write_text(PLAN.replace("[0, 30]", "[0]"))
    for answer, sets in ((b"n\n", 4), (b"y\n", 2)):
        primary, secondary = os.openpty()
        try:
            os.write(primary, answer)
            process = spawn("session", "resume", plan.parent / "stones", "--rig", "rig.toml",
                            stdin=secondary)  # fmt: skip
            _, error = process.communicate(timeout=60)
        finally:
            os.close(primary)
            os.close(secondary)
        assert process.returncode == 0, error
        assert "the changed plan" in error
        assert len(SessionFolder(Path("stones")).plan) == sets


def leave_out(specimen: str) -> None:
    with session_folder(Path("stones")) as folder:
        entry = SetEntry(
            specimen=specimen, orientation_deg=30.0, repeat=1, skipped="left out by the operator"
        )
        folder.update(folder.journal.with_entry(entry))


@pytest.mark.usefixtures("plan")
def test_sets_that_were_left_out_are_counted_and_captured_when_asked_for(ps4rig: Command) -> None:
    leave_out("rock-1")
    done = ps4rig("session", "resume", "stones", "--yes")
    assert done.exit_code == 0
    assert "0 missing, 1 left out" in done.stdout
    assert "resume stones --left-out" in done.stdout
    status = ps4rig("session", "status", "stones").stdout
    assert "rock-1 at 30 degrees" in status
    assert "resume stones --left-out" in status
    done = ps4rig("session", "resume", "stones", "--yes", "--left-out", "--json")
    assert json.loads(done.stdout) == {
        "session": "stones", "finish": "complete", "captured": 1, "missing": 0, "left_out": 0,
    }  # fmt: skip
    assert "left-out" not in ps4rig("session", "status", "stones").stdout


@pytest.mark.usefixtures("plan")
def test_a_left_out_set_that_fails_again_stays_left_out(
    ps4rig: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def rejects(*_: object, **__: object) -> None:
        raise SetRejected("LED 2 is dark")

    leave_out("rock-1")
    monkeypatch.setattr(runner, "capture_set", rejects)
    done = ps4rig("session", "resume", "stones", "--yes", "--left-out", "--json")
    assert json.loads(done.stdout)["left_out"] == 1


def test_the_plan_is_found_from_inside_the_session(
    ps4rig: Command, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan.write_text(PLAN.replace("[0, 30]", "[0]"))
    monkeypatch.chdir("stones")
    done = ps4rig("session", "resume", ".", "--rig", "../rig.toml", "--yes")
    assert "orientations_deg" in done.stderr
