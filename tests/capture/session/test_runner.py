"""The runner of a session on the simulated rig."""

import csv
import errno
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest

from capture import CapturedSet
from capture.base.errors import SetRejected
from capture.calibration.ps4cal import CalibrationFile
from capture.session import runner
from capture.session.events import (
    Answer,
    DecideFailure,
    DecideWarnings,
    PlaceSheet,
    PlaceSpecimen,
    Question,
    RigCompared,
    SessionFinished,
    SetAdopted,
    SetCaptured,
    SetDamaged,
    without_questions,
)
from capture.session.folder import SessionFolder, make_session, session_folder
from capture.session.plan_change import use_plan
from capture.session.rig_checks import compare_rig
from capture.session.runner import run_session
from capture.session.verification import files_below, verify_file
from classify.base.errors import CalibrationRejected, InputError
from rig import CameraError, HardwareError, Rig, RigConfig, open_rig

from .conftest import PLAN, Run, Script

Folder = Callable[[], SessionFolder]
FILES = ["rock-1-0-1", "rock-1-40-1", "sand-1-0-1", "sand-1-40-1"]


def names(folder: SessionFolder) -> list[str]:
    return sorted(path.name.removesuffix(".ome.tif") for path in (folder.path / "sets").iterdir())


def test_a_session_captures_each_planned_set(run: Run, folder: Folder) -> None:
    script = run()
    done = folder()
    assert names(done) == FILES
    assert done.missing() == []
    assert [run.finish for run in done.journal.runs] == ["complete"]
    assert script.events[-1] == SessionFinished("complete", None, 4, 0, 0)
    asked = [question.planned for question in script.questions]
    assert [(each.specimen, each.orientation_deg) for each in asked] == [
        ("rock-1", 0.0), ("rock-1", 40.0), ("sand-1", 0.0), ("sand-1", 40.0),
    ]  # fmt: skip
    captured = CapturedSet.load(done.path / "sets" / "rock-1-40-1.ome.tif")
    about = captured.metadata
    assert (about.label, about.specimen, about.operator) == ("rock", "rock-1", "J. Wu")
    assert (about.note, about.orientation_deg, about.simulated) == ("chipped", 40.0, True)


def test_a_stopped_session_goes_on_with_what_is_missing(run: Run, folder: Folder) -> None:
    run(Answer.GO, Answer.STOP)
    assert names(folder()) == FILES[:1]
    assert folder().journal.runs[0].finish == "stopped"
    script = run()
    assert [question.planned.file_name for question in script.questions] == [
        f"{name}.ome.tif" for name in FILES[1:]
    ]
    assert names(folder()) == FILES
    assert run().questions == []


def test_a_skipped_placement_is_not_missing(run: Run, folder: Folder) -> None:
    run(Answer.SKIP)
    assert names(folder()) == FILES[1:]
    assert folder().missing() == []
    (skipped,) = (entry for entry in folder().journal.entries if entry.skipped)
    assert skipped.skipped.startswith("left out")
    assert "rock-1,rock,0,1,true,left out,," in (folder().path / "sets.csv").read_text()


def test_a_repeated_placement_keeps_the_earlier_set_aside(run: Run, folder: Folder) -> None:
    script = run(Answer.GO, Answer.REPEAT, Answer.GO)
    done = folder()
    assert names(done) == FILES
    (old,) = (done.path / "replaced").iterdir()
    new = CapturedSet.load(done.path / "sets" / "rock-1-0-1.ome.tif")
    assert new.metadata.pixels_sha256 != CapturedSet.load(old).metadata.pixels_sha256
    assert len(done.journal.entries) == 4
    placed = [each.planned.file_name for each in script.questions]
    assert placed[:3] == [f"{name}.ome.tif" for name in (FILES[0], FILES[1], FILES[1])]


def test_a_repeat_before_any_capture_asks_again(run: Run, folder: Folder) -> None:
    script = run(Answer.REPEAT, Answer.STOP)
    assert not any(isinstance(event, SetCaptured) for event in script.events)
    assert len(script.questions) == 2
    assert folder().journal.entries == ()


def test_a_repeat_after_a_skip_captures_what_stands_below_the_camera(
    run: Run, folder: Folder
) -> None:
    run(Answer.GO, Answer.SKIP, Answer.REPEAT, Answer.STOP)
    assert names(folder()) == FILES[:1]
    assert [bool(entry.skipped) for entry in folder().journal.entries] == [True, False]


def test_a_kill_in_a_repeat_leaves_a_file_that_the_next_run_enters(
    run: Run, folder: Folder, session: Path
) -> None:
    run()
    before = folder().journal
    (session / "sets" / f"{FILES[0]}.ome.tif").unlink()
    run()
    # As if the program had been killed after it replaced the set and before it wrote the journal.
    killed = folder().journal.runs[-1].model_copy(update={"ended_utc": None, "finish": None})
    before.with_run(killed).write(session / "journal.json")
    run()
    assert [each.state for path in files_below(session) for each in verify_file(path)] == (
        ["good"] * 5
    )


@pytest.mark.parametrize(("lights", "copied"), [(4, FILES[0]), (6, FILES[1])])
def test_a_set_copied_from_another_session_is_not_entered(
    run: Run,
    folder: Folder,
    session: Path,
    tmp_path: Path,
    config: RigConfig,
    monkeypatch: pytest.MonkeyPatch,
    lights: int,
    copied: str,
) -> None:
    (tmp_path / "other").mkdir()
    plan = tmp_path / "other" / "stones.toml"
    plan.write_text(PLAN, encoding="utf-8")
    other = config.with_changes(
        lights={"tilts_deg": tuple(360.0 / lights * light for light in range(lights))},
        camera={"exposure_ms": 15.0},
    )
    with session_folder(make_session(plan)) as foreign:
        run_session(foreign, other, Script([Answer.GO] * 2 + [Answer.STOP]).ask, [].append)
    # The runs of this session begin after those of the other one.
    monkeypatch.setattr(runner, "utc_text", lambda: "2100-01-01T00:00:00Z")
    run(Answer.GO, Answer.STOP)
    # In place of a captured set, and of a missing one.
    shutil.copy(foreign.path / "sets" / f"{copied}.ome.tif", session / "sets")
    script = run()
    assert not any(isinstance(event, SetAdopted) for event in script.events)
    assert folder().missing() == []
    assert folder().journal.lights == 4
    assert len(list((session / "replaced").iterdir())) == 1


def test_a_captured_set_that_is_left_out_later_is_kept_aside(
    run: Run, folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(Answer.GO, Answer.STOP)
    answers = iter((Answer.GO, Answer.REPEAT, Answer.SKIP, Answer.STOP))

    def ask(_: Question) -> Answer:
        answer = next(answers)
        if answer is Answer.REPEAT:
            failing(monkeypatch, SetRejected("the lens is covered"), 1)
        return answer

    run(ask=ask)
    # The first run's set, and the second's, which was repeated and then skipped.
    assert names(folder()) == FILES[:1]
    (aside,) = (folder().path / "replaced").iterdir()
    assert aside.name.endswith(f"{FILES[1]}.ome.tif")
    assert all(
        each.state == "good" for path in files_below(folder().path) for each in verify_file(path)
    )


def test_a_copy_of_a_set_is_not_another_repeat(plan_file: Path, config: RigConfig) -> None:
    plan_file.write_text(PLAN.replace("[0, 40]", "[0]\nrepeats = 2"))
    session = make_session(plan_file)
    with session_folder(session) as folder:
        run_session(folder, config, Script([Answer.GO, Answer.STOP]).ask, lambda _: None)
        folder.journal.model_copy(update={"entries": folder.journal.entries[:1]}).write(
            session / "journal.json"
        )
    shutil.copy(session / "sets" / "rock-1-0-1.ome.tif", session / "sets" / "rock-1-0-2.ome.tif")
    with session_folder(session) as folder:
        run_session(folder, config, without_questions, lambda _: None)
        hashes = {entry.pixels_sha256 for entry in folder.journal.entries}
    assert len(hashes) == 4
    assert len(list((session / "replaced").iterdir())) == 1


def test_a_deleted_file_is_missing_again(run: Run, folder: Folder) -> None:
    run()
    (folder().path / "sets" / f"{FILES[2]}.ome.tif").unlink()
    assert [planned.file_name for planned in folder().missing()] == [f"{FILES[2]}.ome.tif"]
    run()
    assert names(folder()) == FILES
    shutil.rmtree(folder().path / "sets")
    run()
    assert names(folder()) == FILES


def test_a_file_that_a_killed_run_wrote_is_adopted_not_captured_twice(
    run: Run, folder: Folder
) -> None:
    run(Answer.GO, Answer.GO, Answer.STOP)
    done = folder()
    # As if the program had been killed after it wrote the set and before it wrote the journal.
    before = done.journal.entries[-1]
    done.journal.model_copy(update={"entries": done.journal.entries[:1]}).write(
        done.path / "journal.json"
    )
    script = run()
    (adopted,) = (event for event in script.events if isinstance(event, SetAdopted))
    assert adopted.entry == before
    assert sum(isinstance(event, SetCaptured) for event in script.events) == 2
    assert names(folder()) == FILES


def test_a_damaged_or_foreign_file_is_captured_anew_and_kept_aside(
    run: Run, folder: Folder, session: Path
) -> None:
    run(Answer.GO, Answer.STOP)
    first = session / "sets" / f"{FILES[0]}.ome.tif"
    shutil.copy(first, session / "sets" / f"{FILES[2]}.ome.tif")  # another specimen
    (session / "sets" / f"{FILES[1]}.ome.tif").write_bytes(first.read_bytes()[:5000])
    run()
    assert folder().missing() == []
    for name in FILES:
        CapturedSet.load(session / "sets" / f"{name}.ome.tif")
    assert len(list((session / "replaced").iterdir())) == 2


def damage(path: Path, how: str) -> None:
    """Flip one byte of the pixels, cut the file, or put another set in its place."""
    whole = bytearray(path.read_bytes())
    if how == "flipped":
        whole[len(whole) // 2] ^= 1
    elif how == "cut":
        del whole[5000:]
    else:
        whole = bytearray((path.parent / f"{FILES[3]}.ome.tif").read_bytes())
    path.write_bytes(whole)


@pytest.mark.parametrize(("how", "number"), [("flipped", 0), ("cut", 1), ("exchanged", 1)])
def test_a_captured_set_that_was_damaged_later_is_captured_again(
    run: Run, folder: Folder, session: Path, how: str, number: int
) -> None:
    run()
    path = session / "sets" / f"{FILES[number]}.ome.tif"
    damage(path, how)
    bytes_before = path.read_bytes()
    script = run()
    (damaged,) = (event for event in script.events if isinstance(event, SetDamaged))
    assert damaged.planned.file_name == path.name
    assert damaged.reason
    (captured,) = (event for event in script.events if isinstance(event, SetCaptured))
    assert captured.entry.file == f"sets/{path.name}"
    (aside,) = (session / "replaced").iterdir()
    assert aside.read_bytes() == bytes_before
    assert names(folder()) == FILES
    aside.unlink()
    assert {each.state for path in files_below(session) for each in verify_file(path)} == {"good"}


@pytest.mark.parametrize("error", [MemoryError(), OSError(errno.EIO, "Input/output error")])
def test_a_set_that_cannot_be_read_for_a_moment_stays(
    run: Run, folder: Folder, session: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """The file may be whole: nobody must capture the set again."""
    run()
    with monkeypatch.context() as patch:
        patch.setattr("tifffile.TiffPage.asarray", Mock(side_effect=error))
        with pytest.raises(InputError, match=r"may be intact"):
            run()
        found = dict(folder().read_again())
    assert [planned.file_name for planned in found] == [f"{name}.ome.tif" for name in FILES]
    assert all(isinstance(each, InputError) for each in found.values())
    assert names(folder()) == FILES
    assert not (session / "replaced").exists()
    run()


def test_a_set_without_entry_that_cannot_be_read_for_a_moment_stays(
    run: Run, folder: Folder, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(Answer.GO, Answer.STOP)
    killed = folder()
    killed.journal.model_copy(update={"entries": ()}).write(session / "journal.json")
    error = OSError(errno.EIO, "Input/output error")
    with monkeypatch.context() as patch:
        patch.setattr("tifffile.TiffPage.asarray", Mock(side_effect=error))
        with pytest.raises(InputError, match=r"Input/output error.*intact"):
            run()
    (adopted,) = (event for event in run().events if isinstance(event, SetAdopted))
    assert adopted.entry == killed.journal.entries[0]
    assert not (session / "replaced").exists()


def test_a_run_that_stops_at_once_leaves_a_damaged_set_missing(
    run: Run, folder: Folder, session: Path
) -> None:
    run()
    damage(session / "sets" / f"{FILES[1]}.ome.tif", "cut")
    run(Answer.STOP)
    assert [planned.file_name for planned in folder().missing()] == [f"{FILES[1]}.ome.tif"]
    assert "rock-1,rock,40,1,true,missing,," in (session / "sets.csv").read_text()


def test_a_rig_with_another_number_of_lights_or_size_of_frames_is_refused(
    run: Run, folder: Folder, config: RigConfig
) -> None:
    run(Answer.GO, Answer.STOP)
    eight = {"tilts_deg": tuple(45.0 * light for light in range(8))}
    with pytest.raises(InputError, match=r"stones: .* 4 lights, .* 8"):
        run(rig=config.with_changes(lights=eight).model_copy(update={"name": "big"}))
    assert len(folder().journal.runs) == 1
    larger = config.with_changes(camera={"width_px": 192, "height_px": 128})
    with pytest.raises(InputError, match=r"128 x 128 px, .* 192 x 128"):
        run(rig=larger)


def test_the_table_keeps_the_label_of_a_captured_set(
    run: Run, session: Path, plan_file: Path
) -> None:
    run(Answer.GO, Answer.STOP)
    plan_file.write_text(PLAN.replace('label = "rock"', 'label = "granite"'), encoding="utf-8")
    with session_folder(session) as opened:
        use_plan(plan_file, opened)
    rows = list(csv.DictReader((session / "sets.csv").open(encoding="utf-8")))
    assert [row["label"] for row in rows[:2]] == ["rock", "granite"]


def failing(monkeypatch: pytest.MonkeyPatch, error: Exception, times: int) -> None:
    """Let the next captures of the runner raise `error`, as failures of the rig do."""
    real, left = runner.capture_set, [error] * times

    def capture_set(*arguments: object, **options: object) -> CapturedSet:
        if left:
            raise left.pop()
        return real(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(runner, "capture_set", capture_set)


def test_a_rejected_set_is_asked_about(
    run: Run, folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, SetRejected("LED 2 is dark"), 2)
    script = run(Answer.GO, Answer.REPEAT, Answer.SKIP)
    asked = [type(question) for question in script.questions[:3]]
    assert asked == [PlaceSpecimen, DecideFailure, DecideFailure]
    assert names(folder()) == FILES[1:]
    assert folder().journal.entries[0].skipped == "LED 2 is dark"


def test_a_set_that_equals_another_one_is_captured_again(
    run: Run, folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(Answer.GO, Answer.STOP)
    run()  # the simulated rig begins with the same noise
    hashes = {entry.pixels_sha256 for entry in folder().journal.entries}
    assert len(hashes) == 4
    first = CapturedSet.load(folder().path / "sets" / f"{FILES[0]}.ome.tif")
    monkeypatch.setattr(runner, "capture_set", lambda *_, **__: first)
    (folder().path / "sets" / f"{FILES[3]}.ome.tif").unlink()
    script = run(Answer.GO, Answer.SKIP)
    assert isinstance(script.questions[1], DecideFailure)
    assert script.questions[1].reason == (
        f"every pixel is that of sets/{FILES[0]}.ome.tif: the camera repeats its images; restart it"
    )


def test_without_questions_a_rejected_set_stays_missing(
    run: Run, folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, SetRejected("LED 2 is dark"), 1)
    run(ask=without_questions)
    assert [planned.file_name for planned in folder().missing()] == [f"{FILES[0]}.ome.tif"]
    assert folder().journal.runs[-1].finish == "incomplete"


def test_a_pulled_camera_loses_no_set(
    run: Run, folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(Answer.GO, Answer.STOP)
    failing(monkeypatch, CameraError("/dev/video0: no such device"), 1)
    with pytest.raises(HardwareError, match="no such device"):
        run(ask=without_questions)
    last = folder().journal.runs[-1]
    assert (last.finish, last.reason) == ("failed", "/dev/video0: no such device")
    assert names(folder()) == FILES[:1]
    # Plugged in again, the operator goes on at once.
    failing(monkeypatch, CameraError("/dev/video0: no such device"), 1)
    script = run(Answer.GO, Answer.REPEAT)
    assert script.questions[1] == DecideFailure(
        script.questions[0].planned, "/dev/video0: no such device", lost_rig=True
    )
    assert names(folder()) == FILES


def test_an_interrupt_between_sets_is_in_the_journal(run: Run, folder: Folder) -> None:
    def interrupt(question: Question) -> Answer:
        if question.planned.specimen == "sand-1":
            raise KeyboardInterrupt
        return Answer.GO

    with pytest.raises(KeyboardInterrupt):
        run(ask=interrupt)
    assert folder().journal.runs[-1].finish == "interrupted"
    assert names(folder()) == FILES[:2]


def test_a_wrong_orientation_is_asked_about(session: Path, config: RigConfig) -> None:
    asked = []

    def ask(question: Question) -> Answer:
        if isinstance(question, DecideWarnings):
            asked.append(question)
            return Answer.STOP
        return Answer.GO

    # The part was not turned: the entered 40 degrees are wrong.
    plan = session / "plan.toml"
    with session_folder(session) as folder:
        run_session(folder, config, lambda _: _once(folder), lambda _: None)
        first = next(folder.plan.sets())
        path = folder.file_of(first)
        wrong = CapturedSet.load(path)
        about = wrong.metadata.model_copy(update={"orientation_deg": 20.0})
        CapturedSet(wrong.images, wrong.ambient, about).save(path)
        run_session(folder, config, ask, lambda _: None)
    (question,) = asked
    assert "60 degrees, 40 were entered" in question.warnings[0]
    assert plan.is_file()


def _once(folder: SessionFolder) -> Answer:
    return Answer.STOP if folder.journal.entries else Answer.GO


def test_the_turntable_turns_before_each_placement(
    plan_file: Path, tmp_path: Path, config: RigConfig
) -> None:
    said = tmp_path / "angles.txt"
    program = tmp_path / "turn.py"
    program.write_text(f"import sys; open({str(said)!r}, 'a').write(sys.argv[1] + ' ')")
    command = f"{sys.executable} {program} {{angle}}"
    plan_file.write_text(f"turntable = '{command}'\n" + PLAN)
    with session_folder(make_session(plan_file)) as folder:
        run_session(folder, config, without_questions, lambda _: None)
    assert said.read_text() == "0 40 0 40 "


@pytest.mark.parametrize(
    ("timeout_s", "code", "message"),
    [
        (30, "import sys; sys.exit('stuck')", r"turntable .*: .*status 1: stuck"),
        (0.2, "import time; time.sleep(60)", r"turntable .*: .* 0.2 s"),
    ],
)
def test_a_turntable_that_fails_stops_the_session(
    plan_file: Path, tmp_path: Path, config: RigConfig, timeout_s: float, code: str, message: str
) -> None:
    program = tmp_path / "turn.py"
    program.write_text(code)
    plan_file.write_text(
        f"turntable = '{sys.executable} {program} {{angle}}'\n"
        f"turntable_timeout_s = {timeout_s}\n{PLAN}"
    )
    with (
        session_folder(make_session(plan_file)) as folder,
        pytest.raises(HardwareError, match=message),
    ):
        run_session(folder, config, without_questions, lambda _: None)


def test_an_exposure_is_searched_for_each_specimen(plan_file: Path, config: RigConfig) -> None:
    plan_file.write_text('exposure_ms = "search"\n' + PLAN)
    dim = config.with_changes(camera={"exposure_ms": 1.0})
    with session_folder(make_session(plan_file)) as folder:
        run_session(folder, dim, without_questions, lambda _: None)
        for name in FILES:
            captured = CapturedSet.load(folder.path / "sets" / f"{name}.ome.tif")
            bright = captured.images.max() / captured.metadata.full_scale
            assert 0.4 < bright <= 1.0
            assert captured.metadata.camera.exposure_ms > 3.0


def test_a_required_calibration_travels_with_the_sets(
    plan_file: Path,
    near_config: RigConfig,
    near_calibration: CalibrationFile,
    tmp_path: Path,
) -> None:
    plan_file.write_text("calibration_required = true\n" + PLAN)
    with session_folder(make_session(plan_file)) as folder:
        with pytest.raises(InputError, match="names no calibration"):
            run_session(folder, near_config, without_questions, lambda _: None)
        path = tmp_path / "rig.ps4cal"
        near_calibration.write(path)
        known = near_config.model_copy(update={"calibration": str(path)})
        run_session(folder, known, without_questions, lambda _: None)
        assert folder.missing() == []
        (copy,) = (folder.path / "calibration").iterdir()
        assert CalibrationFile.read(copy).hash == near_calibration.hash
        for entry in folder.journal.entries:
            assert entry.file is not None
            captured = CapturedSet.load(folder.path / entry.file)
            assert captured.metadata.calibration_ids == (near_calibration.hash,)
            if entry.orientation_deg > 0.0:
                assert entry.measures.estimated_deg == pytest.approx(40.0, abs=2.0)
    path.unlink()
    assert {finding.state for each in files_below(tmp_path) for finding in verify_file(each)} == {
        "good"
    }


def test_a_damaged_copy_of_the_calibration_is_written_again(
    run: Run, folder: Folder, calibrated_config: RigConfig
) -> None:
    run(rig=calibrated_config)
    (copy,) = (folder().path / "calibration").iterdir()
    whole = CalibrationFile.read(copy).hash
    copy.write_bytes(copy.read_bytes()[:-200])
    (folder().path / "sets" / f"{FILES[-1]}.ome.tif").unlink()
    run(rig=calibrated_config)
    assert folder().missing() == []
    assert CalibrationFile.read(copy).hash == whole


@pytest.fixture
def calibrated_config(
    near_config: RigConfig, near_calibration: CalibrationFile, tmp_path: Path
) -> RigConfig:
    """The near rig, with its calibration."""
    path = tmp_path / "rig.ps4cal"
    near_calibration.write(path)
    return near_config.model_copy(update={"calibration": str(path)})


def compared(script: Script) -> list[str]:
    """What the comparison with the calibration has found."""
    (event,) = (event for event in script.events if isinstance(event, RigCompared))
    return [check.status for check in event.checks]


def test_a_session_begins_with_a_comparison_of_the_rig(
    run: Run, folder: Folder, calibrated_config: RigConfig
) -> None:
    script = run(rig=calibrated_config)
    assert compared(script) == ["ok"]
    # The simulated rig lays the sheet down, and nobody is asked for it.
    assert {type(question) for question in script.questions} == {PlaceSpecimen}
    assert folder().missing() == []
    assert not [e for e in run(rig=calibrated_config).events if isinstance(e, RigCompared)]


def weaker(config: RigConfig, factor: float) -> RigConfig:
    levels = config.simulation.led_levels
    return config.with_changes(simulation={"led_levels": (*levels[:3], factor * levels[3])})


def test_an_led_that_drifted_warns_or_stops_the_session(
    run: Run, folder: Folder, calibrated_config: RigConfig
) -> None:
    with pytest.raises(CalibrationRejected, match=r"light 3 gives 2\d% less"):
        run(rig=weaker(calibrated_config, 0.78))
    last = folder().journal.runs[-1]
    assert last.finish == "failed"
    assert last.reason is not None
    assert "light 3" in last.reason
    assert not list((folder().path / "sets").glob("*"))
    assert compared(run(rig=weaker(calibrated_config, 0.87))) == ["warning"]


def real(rig: Rig) -> Rig:
    """A rig that cannot lay a sheet down itself."""
    return replace(rig, simulation=None)


def test_a_person_is_asked_for_the_sheet_and_again_if_the_calibration_does_not_hold(
    near_config: RigConfig, near_calibration: CalibrationFile
) -> None:
    def asked(*answers: Answer) -> Script:
        script = Script(answers)
        compare_rig(real(rig), near_calibration, script.ask, script.events.append)
        return script

    with open_rig(near_config) as rig:
        assert asked(Answer.GO).questions == [PlaceSheet(None)]
        assert compared(asked(Answer.SKIP)) == ["unknown"]
        assert asked(Answer.STOP).events == []
    with open_rig(near_config.with_changes(simulation={"placement": {"surface": "rock"}})) as rig:
        with pytest.raises(CalibrationRejected, match="not a white"):
            asked(Answer.GO, Answer.STOP)
        script = asked(Answer.GO, Answer.SKIP)
        _, second = script.questions
        assert isinstance(second, PlaceSheet)
        assert second.cause is not None
        assert "not a white" in second.cause


def test_without_questions_no_sheet_is_expected_below_a_real_camera() -> None:
    assert without_questions(PlaceSheet(None)) is Answer.SKIP


def test_a_missing_calibration_begins_no_run(
    run: Run, folder: Folder, config: RigConfig, tmp_path: Path
) -> None:
    rig = config.model_copy(update={"calibration": str(tmp_path / "missing.ps4cal")})
    with pytest.raises(InputError, match="no such calibration"):
        run(rig=rig)
    assert folder().journal.runs == ()
