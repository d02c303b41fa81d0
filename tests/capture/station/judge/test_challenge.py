"""Tests of the challenge set: a changed recipe runs only if every part gets its verdict."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.errors import ChallengeFailed, RecipeError
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.domain.verdict import Decision
from capture.station.judge import fingerprint
from capture.station.judge.challenge import (
    PartOutcome,
    replay_challenge,
    require_challenge,
)
from capture.station.judge.challenge_set import FILE, add_to_challenge, challenge_sets
from capture.station.judge.inspector import Inspection, Inspector
from capture.station.judge.recipe_state import state_of
from classify.base.errors import InputError
from tests.capture.station.teaching_sets import saved


def changed(files: RecipeFolder) -> None:
    """Change one limit so that good parts fail."""
    recipe = read_recipe(files.file)
    limits = recipe.limits_of["rock"].model_copy(update={"sdq": (0.1, 0.2)})
    write_recipe(files.file, recipe.model_copy(update={"limits_of": {"rock": limits}}))


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> list[str | None]:
    """Labels of the sets that inspectors judge from now on."""
    labels: list[str | None] = []
    inspect = Inspector.inspect

    def noted(inspector: Inspector, captured: CapturedSet) -> Inspection:
        labels.append(captured.metadata.label)
        return inspect(inspector, captured)

    monkeypatch.setattr(Inspector, "inspect", noted)
    return labels


def test_a_challenge_that_is_met_is_replayed_once(
    files: RecipeFolder, judged: list[str | None]
) -> None:
    replay = require_challenge(files, Inspector.load(files))
    assert [(part.expected, part.found) for part in replay.parts] == [
        ("PASS", "PASS"),
        ("FAIL", "FAIL"),
    ]
    assert require_challenge(files, Inspector.load(files)) == replay
    assert judged == ["rock", "sand", "rock"]  # the second time the first part alone


def test_a_changed_limit_blocks_and_the_part_is_named(files: RecipeFolder) -> None:
    require_challenge(files, Inspector.load(files))
    changed(files)
    with pytest.raises(ChallengeFailed, match=r"rock-3.ome.tif must be PASS and is FAIL: Sdq 0"):
        require_challenge(files, Inspector.load(files))
    # It stays blocked without another replay.
    with pytest.raises(ChallengeFailed, match=r"1 of 2 parts"):
        require_challenge(files, Inspector.load(files))


def test_a_bad_part_that_passes_now_blocks_although_a_replay_is_on_record(
    files: RecipeFolder, monkeypatch: pytest.MonkeyPatch, judged: list[str | None]
) -> None:
    """Another processor or a failing one: software and files are those of the recorded replay."""
    saved(files.challenge, "malv", range(1))
    expected = {"sand-2": "FAIL", "malv-0": "UNKNOWN", "rock-3": "PASS"}
    lines = [f'"{name}.ome.tif" = "{verdict}"\n' for name, verdict in expected.items()]
    (files.challenge / FILE).write_text("".join(["[sets]\n", *lines]))
    require_challenge(files, Inspector.load(files))
    require_challenge(files, Inspector.load(files))
    assert judged == ["sand", "malv", "rock"] * 2  # up to the first good part
    good = Inspector.load(files).inspect(CapturedSet.load(files.challenge / "rock-3.ome.tif"))
    inspect = Inspector.inspect

    def passing(inspector: Inspector, captured: CapturedSet) -> Inspection:
        return good if captured.metadata.label == "malv" else inspect(inspector, captured)

    monkeypatch.setattr(Inspector, "inspect", passing)
    with pytest.raises(ChallengeFailed, match=r"malv-0.ome.tif must be UNKNOWN and is PASS"):
        require_challenge(files, Inspector.load(files))
    assert not state_of(files, None).has_met_challenge


@pytest.mark.parametrize(
    ("found", "pixels_sha256", "is_regression"),
    [
        ("UNKNOWN", "0" * 64, False),
        ("FAIL", "0" * 64, False),
        ("ERROR", "0" * 64, False),
        ("PASS", "0" * 64, True),
        ("ERROR", None, True),
    ],
)
def test_a_bad_part_may_be_rejected_in_any_way(
    found: Decision, pixels_sha256: str | None, is_regression: bool
) -> None:
    outcome = PartOutcome(
        file="a", pixels_sha256=pixels_sha256, expected="reject", found=Decision(found), reason=""
    )
    assert outcome.is_regression is is_regression


def test_a_part_that_cannot_be_judged_is_a_regression(files: RecipeFolder) -> None:
    next(files.challenge.glob("rock-3*")).write_bytes(b"damaged")
    outcomes = list(replay_challenge(files, Inspector.load(files)))
    assert outcomes[0].is_regression
    assert outcomes[0].found == "ERROR"


def test_changed_code_of_the_same_version_needs_another_replay(
    files: RecipeFolder, monkeypatch: pytest.MonkeyPatch, judged: list[str | None]
) -> None:
    before = require_challenge(files, Inspector.load(files))
    monkeypatch.setattr(
        "capture.station.judge.fingerprint.software_sha256", lambda: "of other code"
    )
    inspector = Inspector.load(files)
    assert not state_of(files, None).has_met_challenge
    require_challenge(files, inspector)
    assert judged == ["rock", "sand"] * 2
    assert before.fingerprint.software_version == inspector.fingerprint.software_version


@pytest.mark.parametrize("lacking", ["software_sha256", "file_sha256"])
def test_a_replay_of_a_program_that_hashed_less_is_outdated(
    files: RecipeFolder, lacking: str
) -> None:
    replay = require_challenge(files, Inspector.load(files))
    values = json.loads(files.replay.read_text())
    for hashed in (values["fingerprint"], *values["parts"]):
        hashed.pop(lacking, None)
    files.replay.write_text(json.dumps(values))
    assert not state_of(files, None).has_met_challenge
    again = require_challenge(files, Inspector.load(files))
    assert (again.fingerprint, again.parts) == (replay.fingerprint, replay.parts)


def test_a_set_that_was_replaced_under_its_name_needs_another_replay(
    files: RecipeFolder, tmp_path: Path
) -> None:
    require_challenge(files, Inspector.load(files))
    path = files.challenge / "sand-2.ome.tif"
    before, (other,) = path.stat(), saved(tmp_path, "malv", range(1))
    path.write_bytes(other.read_bytes())
    # The times of the file prove nothing.
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert not state_of(files, None).has_met_challenge
    with pytest.raises(ChallengeFailed, match=r"sand-2.ome.tif must be FAIL and is UNKNOWN"):
        require_challenge(files, Inspector.load(files))


def test_a_set_that_was_removed_needs_another_replay_and_blocks(files: RecipeFolder) -> None:
    require_challenge(files, Inspector.load(files))
    kept = files.challenge / "sand-2.ome.tif"
    moved = kept.rename(files.challenge / "sand-3.ome.tif")
    assert not state_of(files, None).has_met_challenge
    with pytest.raises(ChallengeFailed, match=r"sand-2.ome.tif must be FAIL and is ERROR"):
        require_challenge(files, Inspector.load(files))
    moved.rename(kept)
    assert not require_challenge(files, Inspector.load(files)).regressions


def test_the_hash_of_the_software_changes_with_any_source_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in ("capture/station", "classify", "rig"):
        (tmp_path / package).mkdir(parents=True)
        (tmp_path / package / "a.py").write_text("a = 1\n")
    monkeypatch.setattr(fingerprint, "HOME", tmp_path)
    hashed = fingerprint.software_sha256.__wrapped__
    found = {hashed()}
    (tmp_path / "classify/a.py").write_text("a = 2\n")
    found.add(hashed())
    (tmp_path / "classify/a.py").rename(tmp_path / "classify/b.py")
    found.add(hashed())
    monkeypatch.setattr(fingerprint, "version", lambda _: "another")
    found.add(hashed())
    assert len(found) == 4
    (tmp_path / "classify/notes.txt").write_text("no code")
    assert hashed() in found


def test_added_parts_need_another_replay(files: RecipeFolder, tmp_path: Path) -> None:
    require_challenge(files, Inspector.load(files))
    add_to_challenge(files.challenge, saved(tmp_path / "more", "malv", range(1)), "PASS")
    with pytest.raises(ChallengeFailed, match=r"malv-0.ome.tif must be PASS and is UNKNOWN"):
        require_challenge(files, Inspector.load(files))


@pytest.mark.parametrize(("verdict", "counts"), [("PASS", "1 .* 0 "), ("FAIL", "0 .* 1 ")])
def test_a_challenge_of_one_kind_of_parts_proves_nothing(
    files: RecipeFolder, verdict: str, counts: str
) -> None:
    (files.challenge / FILE).write_text(f'[sets]\n"rock-3.ome.tif" = "{verdict}"\n')
    with pytest.raises(RecipeError, match=f"{counts}that must not: add one of each"):
        require_challenge(files, Inspector.load(files))


def test_a_missing_challenge_says_how_to_make_one(files: RecipeFolder) -> None:
    (files.challenge / FILE).unlink()
    with pytest.raises(InputError, match="no challenge set; add parts with ps4rig station"):
        require_challenge(files, Inspector.load(files))


def test_another_set_of_the_same_name_is_refused(files: RecipeFolder, tmp_path: Path) -> None:
    other = saved(tmp_path / "other", "malv", range(1))[0].rename(tmp_path / "rock-3.ome.tif")
    with pytest.raises(RecipeError, match="is another set; rename"):
        add_to_challenge(files.challenge, [other], "FAIL")


def test_two_sets_of_one_name_are_refused_before_a_change_is_recorded(
    files: RecipeFolder, tmp_path: Path
) -> None:
    one, other = (saved(tmp_path / name, name, range(1))[0] for name in ("malv", "sand"))
    both = [path.rename(path.with_name("part.ome.tif")) for path in (one, other)]
    records: list[str] = []
    with pytest.raises(RecipeError, match="is another set; rename"):
        add_to_challenge(files.challenge, both, "FAIL", lambda name, *_: records.append(name))
    assert records == []
    assert not (files.challenge / "part.ome.tif").exists()


def test_a_set_whose_name_cannot_be_kept_is_refused_before_it_is_copied(
    files: RecipeFolder, tmp_path: Path
) -> None:
    (odd,) = saved(tmp_path / "more", "malv", range(1))
    odd = odd.rename(odd.with_name("dent,40,20.ome.tif"))
    with pytest.raises(InputError, match=r"challenge\.toml: .*'dent,40,20\.ome\.tif' becomes part"):
        add_to_challenge(files.challenge, [odd], "FAIL")
    assert not (files.challenge / odd.name).exists()


def test_the_commands_teach_challenge_approve_and_run(
    station: Path, files: RecipeFolder, small_rig: Path, ps4rig: Callable[..., Any]
) -> None:
    assert small_rig
    run = ("station", "run", station, "--no-panel", "--trigger", "timer", "--parts", 1)
    refused = ps4rig(*run)
    assert refused.exit_code == 2
    assert "not approved" in refused.stderr
    assert ps4rig("station", "approve", station, "--by", "Ada").exit_code == 0
    replayed = ps4rig("station", "challenge", station, "--json")
    assert json.loads(replayed.stdout)["passed"] is True
    assert ps4rig(*run).exit_code in (0, 1)
    changed(files)
    assert ps4rig("station", "approve", station, "--by", "Ada").exit_code == 0
    blocked = ps4rig(*run)
    assert blocked.exit_code == 1
    assert "rock-3.ome.tif must be PASS and is FAIL" in blocked.stderr
    shown = ps4rig("station", "challenge", station)
    assert shown.exit_code == 1
    assert "REGRESSION" in shown.stdout
    part = files.challenge / "sand-2.ome.tif"
    assert ps4rig("station", "challenge", station, "--add", part).exit_code == 0
    assert challenge_sets(files.challenge)["sand-2.ome.tif"] == "reject"
