"""The folder of a session: one program at a time, and a plan that may change."""

from pathlib import Path

import pytest

from capture.session.folder import (
    SessionFolder,
    make_session,
    session_folder,
)
from capture.session.journal import Journal, SetEntry, SetMeasures, read_journal
from capture.session.plan import read_plan
from capture.session.plan_change import plan_changes, use_plan
from capture.sets.archive import JOURNAL
from classify.base.errors import InputError

from .conftest import PLAN


def test_other_folders_are_no_session(tmp_path: Path, plan_file: Path) -> None:
    with (
        pytest.raises(InputError, match="folder of a session"),
        session_folder(tmp_path / "none"),
    ):
        pass
    other = tmp_path / "stones"
    other.mkdir()
    (other / "thesis.doc").touch()
    with pytest.raises(InputError, match="choose another name"):
        make_session(plan_file)


def test_a_session_whose_making_was_interrupted_is_made_again(
    tmp_path: Path, plan_file: Path
) -> None:
    (tmp_path / "stones" / "sets").mkdir(parents=True)
    assert len(SessionFolder(make_session(plan_file)).plan) == 4


@pytest.mark.parametrize(
    ("before", "after", "changes"),
    [
        ("[0, 40]", "[0, 40] # a comment", []),
        ("[0, 40]", "[0, 40, 80]", ["orientations_deg: [0.0, 40.0] -> [0.0, 40.0, 80.0]"]),
        ('label = "rock"', "", ['specimen rock-1: label: "rock" -> none']),
        ('"sand-1"', '"sand-2"', ["specimen sand-1: removed", "specimen sand-2: new"]),
        ("[0, 40]", "[0, 40]\naverage = 4", ["average: 1 -> 4"]),
        ("[0, 40]", "[40, 0]", ["orientations_deg: [0.0, 40.0] -> [40.0, 0.0]"]),
    ],
)
def test_each_change_of_a_plan_is_named(
    session: Path, plan_file: Path, before: str, after: str, changes: list[str]
) -> None:
    plan_file.write_text(PLAN.replace(before, after))
    with session_folder(session) as folder:
        assert plan_changes(read_plan(plan_file), folder) == changes
        use_plan(plan_file, folder)
    assert plan_changes(read_plan(plan_file), SessionFolder(session)) == []


def test_a_plan_that_gives_a_set_the_file_of_another_is_refused(
    session: Path, plan_file: Path
) -> None:
    entry = SetEntry(specimen="rock-", orientation_deg=1.0, repeat=1, file="sets/rock--1-1.ome.tif")
    plan_file.write_text(PLAN.replace("[0, 40]", "[-1]").replace('"rock-1"', '"rock"'))
    with session_folder(session) as folder:
        folder.update(folder.journal.with_entry(entry))
        with pytest.raises(InputError, match="which is rock- at 1"):
            use_plan(plan_file, folder)
        assert len(folder.plan) == 4


def test_a_log_that_cannot_be_written_is_named(session: Path) -> None:
    (session / "session.log").mkdir()
    with (
        session_folder(session) as folder,
        pytest.raises(InputError, match=r"session\.log: .*Is a directory"),
    ):
        folder.log("captured")


def test_sets_that_are_no_longer_planned_stay_in_journal_and_table(
    session: Path, plan_file: Path
) -> None:
    entry = SetEntry(specimen="sand-1", orientation_deg=40.0, repeat=1, skipped="wet")
    plan_file.write_text(PLAN.replace("[0, 40]", "[0]"))
    with session_folder(session) as folder:
        folder.update(folder.journal.with_entry(entry))
        use_plan(plan_file, folder)
    rows = (session / "sets.csv").read_text().splitlines()
    assert len(rows) == 1 + 2 + 1
    assert rows[-1].startswith("sand-1,sand-1,40,1,false,left out,")


def test_a_journal_comes_back_as_it_was_written(tmp_path: Path) -> None:
    entry = SetEntry(
        specimen="a", orientation_deg=-0.5, repeat=2, file="sets/a--0.5-2.ome.tif",
        measures=SetMeasures(led_levels=(0.1, 0.2), saturated=0.0, shadowed=0.5, warnings=("x",)),
    )  # fmt: skip
    journal = Journal().with_entry(entry)
    journal.write(tmp_path / JOURNAL)
    assert read_journal(tmp_path / JOURNAL) == journal
    # A new entry takes the place of the one before.
    assert journal.with_entry(entry.model_copy(update={"skipped": "b"})).entries[0].skipped == "b"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "Invalid JSON"),
        ('{"schema_version": 2}', "schema_version"),
    ],
)
def test_a_damaged_journal_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / JOURNAL).write_text(text)
    with pytest.raises(InputError, match="restore it") as caught:
        read_journal(tmp_path / JOURNAL)
    assert message in str(caught.value)
