"""Backup and restore: contents of a backup, and damaged and interrupted backups."""

import json
import os
import shutil
import signal
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.config import Retention
from capture.station.domain.folder import StationFolder
from capture.station.domain.users import Role, Tokens
from capture.station.results.store import open_store
from capture.station.results.verification import verify_station
from capture.station.run.cycle import Station
from capture.station.run.retention import remove_old_sets, sets_stay
from capture.station.service.backup import MANIFEST, opened_backup, prepared_backup
from classify.base.errors import InputError
from tests.capture.station.stations import (
    Manual,
    bench,
    make_days,
    one_after_the_other,
    small_set,
)


def back_up(folder: Path, path: Path) -> Path:
    with prepared_backup(folder, path) as prepared:
        for _ in prepared.write(path):
            pass
    return path


def restore(path: Path, folder: Path) -> Path:
    with opened_backup(path) as opened:
        for _ in opened.restore(folder):
            pass
    return folder


def files_of(folder: Path) -> dict[str, bytes]:
    """Contents of all files but the database and locks."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and ".sqlite" not in path.name and path.suffix not in (".lock", ".held")
    }


def rows_of(folder: Path) -> list[str]:
    with closing(sqlite3.connect(folder / "results.sqlite")) as connection:
        return list(connection.iterdump())


@pytest.fixture
def line(tmp_path: Path) -> Path:
    """A station that has judged three parts, with a user."""
    with bench(tmp_path / "line-1", small_set()) as made:
        made.run(one_after_the_other(3), 3)
    folder = tmp_path / "line-1"
    (folder / "recipes/example").mkdir()
    (folder / "recipes/example.toml").write_text('name = "example"\n')
    (folder / "recipes/example/taught.json").write_text("{}")
    (folder / "users.json").write_text("{}")
    (folder / "users.json").chmod(0o600)
    (folder / "station.log").write_text("one line\n")
    return folder


@pytest.fixture
def stored(line: Path, tmp_path: Path) -> Path:
    return back_up(line, tmp_path / "line-1.ps4backup")


def test_rows_files_and_secrets_come_back(line: Path, stored: Path, tmp_path: Path) -> None:
    restored = restore(stored, tmp_path / "again")
    assert rows_of(restored) == rows_of(line)
    assert files_of(restored) == files_of(line)
    assert (restored / "users.json").stat().st_mode & 0o777 == 0o600
    assert (restored / "station.toml").stat().st_mode & 0o777 == 0o640
    assert restored.stat().st_mode & 0o777 == 0o750
    assert stored.stat().st_mode & 0o777 == 0o600
    assert {finding.state for finding in verify_station(restored)} == {"good"}


def test_locks_are_not_in_a_backup(line: Path, tmp_path: Path) -> None:
    Tokens(line).add("plc", Role.OPERATOR)
    (line / "recipes/example/teaching.lock").write_text("ps4rig, process 1")
    locks = {path.name for path in line.rglob("*") if path.suffix in (".lock", ".held")}
    assert {"tokens.json.held", "teaching.lock"} <= locks
    with zipfile.ZipFile(back_up(line, tmp_path / "line-1.ps4backup")) as archive:
        names = {Path(each).name for each in archive.namelist()}
    assert "tokens.json" in names
    assert not names & locks


def test_a_backup_during_the_run_holds_what_was_announced_before_it(tmp_path: Path) -> None:
    path = tmp_path / "line-1.ps4backup"
    with bench(tmp_path / "line-1", small_set()) as made:

        def feed(station: Station) -> None:
            one_after_the_other(4).run(station)
            while not station.wait_until_ready(0.1) or len(made.announced()) < 4:
                pass
            back_up(tmp_path / "line-1", path)
            one_after_the_other(2).run(station)

        made.run(Manual(feed), 6)
        announced = made.announced()
    restored = restore(path, tmp_path / "again")
    with open_store(str(restored / "results.sqlite"), "line-1", exclusive=False) as store:
        rows = [(each.result.part_id, each.result.verdict.decision) for each in store.parts()]
    assert rows == announced[:4]
    assert {finding.state for finding in verify_station(restored)} == {"good"}


def test_no_set_is_removed_while_a_backup_reads_them(line: Path) -> None:
    later, none_kept = datetime.now(UTC) + timedelta(days=30), Retention(pass_every=1_000_000)
    make_days(line, later)
    with open_store(str(line / "results.sqlite"), "line-1") as store:
        with sets_stay(line), pytest.raises(InputError, match="sets: another program changes it"):
            remove_old_sets(line, store, none_kept, later)
        assert remove_old_sets(line, store, none_kept, later) == 3


def test_sets_that_the_retention_removed_are_not_missed(line: Path, tmp_path: Path) -> None:
    later = datetime.now(UTC) + timedelta(days=30)
    make_days(line, later)
    with open_store(str(line / "results.sqlite"), "line-1") as store:
        remove_old_sets(line, store, Retention(pass_every=1_000_000), later)
    with prepared_backup(line, tmp_path / "b.ps4backup") as prepared:
        assert prepared.remarks == ()
        assert not [name for name in prepared.sources if name.startswith("parts/")]


def test_a_lost_set_and_a_rig_elsewhere_are_remarked(line: Path, tmp_path: Path) -> None:
    next((line / "parts").glob("*/*-000002*")).unlink()
    config = (line / "station.toml").read_text()
    (line / "station.toml").write_text(config.replace('rig = "sim"', 'rig = "../rig.toml"'))
    with prepared_backup(line, tmp_path / "b.ps4backup") as prepared:
        lost, elsewhere = prepared.remarks
        assert list(prepared.write(tmp_path / "b.ps4backup"))
    assert "1 set files of the results are missing" in lost
    assert "../rig.toml: outside the station" in elsewhere
    with opened_backup(tmp_path / "b.ps4backup") as opened:
        assert (opened.manifest.parts, opened.manifest.sets) == (3, 2)
        assert len(opened.manifest.missing) == 1


def test_a_recipe_that_changes_meanwhile_ends_the_backup(line: Path, tmp_path: Path) -> None:
    path = tmp_path / "b.ps4backup"
    recipe = line / "recipes/example.toml"
    with prepared_backup(line, path) as prepared, pytest.raises(InputError, match="repeat the"):
        sum(recipe.write_text('name = "another"\n') for _ in prepared.write(path))
    assert not path.exists()


def a_name_that_is_no_text(line: Path) -> None:
    odd = Path(os.fsdecode(os.fsencode(line) + b"/odd-\xff"))
    odd.mkdir()
    (odd / "notes.txt").write_text("mine")


def a_link(line: Path) -> None:
    (line / "recipes/example/linked").symlink_to(line / "users.json")


def folders_below_each_other(line: Path) -> None:
    (line / "/".join("d" * 20)).mkdir(parents=True)


def a_floor_that_is_not_free(line: Path) -> None:
    config = (line / "station.toml").read_text()
    floor = config.replace("disk_floor_mb = 500", "disk_floor_mb = 10000000")
    (line / "station.toml").write_text(floor)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (a_name_that_is_no_text, "not UTF-8; rename it"),
        (a_link, "is a link"),
        (folders_below_each_other, "more than 16 folders"),
        (a_floor_that_is_not_free, "MB needed with the station's disk floor"),
    ],
)
def test_a_station_that_cannot_be_stored_is_refused_and_nothing_is_made(
    line: Path, tmp_path: Path, change: Callable[[Path], None], said: str
) -> None:
    change(line)
    before = list(tmp_path.iterdir())
    with pytest.raises(InputError, match=said):
        back_up(line, tmp_path / "b.ps4backup")
    assert list(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("line-1.ps4backup", "exists; give another name"),
        ("line-1/b.ps4backup", "inside the station"),
        ("nowhere/b.ps4backup", "there is no folder"),
    ],
)
def test_a_place_that_loses_something_is_refused(
    line: Path, stored: Path, tmp_path: Path, place: str, said: str
) -> None:
    assert stored.exists()
    with pytest.raises(InputError, match=said):
        back_up(line, tmp_path / place)


def test_a_kill_at_any_file_leaves_nothing_half(line: Path, tmp_path: Path) -> None:
    place = tmp_path / "backups"
    place.mkdir()
    with prepared_backup(line, place / "b.ps4backup") as prepared:
        steps = len(prepared.sources)
    for step in range(steps + 1):
        process = os.fork()
        if process == 0:
            with prepared_backup(line, place / "b.ps4backup") as prepared:
                for number, _ in enumerate(prepared.write(place / "b.ps4backup")):
                    if number == step:
                        os.kill(os.getpid(), signal.SIGKILL)
            os._exit(0)
        status = os.waitpid(process, 0)[1]
        assert status == (signal.SIGKILL if step < steps else 0)
        assert (place / "b.ps4backup").exists() == (step == steps)
    assert [path.name for path in place.iterdir() if path.name[0] != "."] == ["b.ps4backup"]
    assert rows_of(restore(place / "b.ps4backup", tmp_path / "again")) == rows_of(line)


def test_a_kill_of_a_restore_leaves_no_folder(stored: Path, tmp_path: Path) -> None:
    process = os.fork()
    if process == 0:
        with opened_backup(stored) as opened:
            for number, _ in enumerate(opened.restore(tmp_path / "again")):
                if number == 2:
                    os.kill(os.getpid(), signal.SIGKILL)
    assert os.waitpid(process, 0)[1] == signal.SIGKILL
    assert not (tmp_path / "again").exists()
    restore(stored, tmp_path / "again")


def test_a_restore_refuses_a_folder_that_holds_something(stored: Path, tmp_path: Path) -> None:
    (tmp_path / "again").mkdir()
    (tmp_path / "again/notes.txt").write_text("mine")
    with pytest.raises(InputError, match="exists and is not empty"):
        restore(stored, tmp_path / "again")
    (tmp_path / "again/notes.txt").unlink()
    assert restore(stored, tmp_path / "again").is_dir()


def rewritten(stored: Path, change: Callable[[dict[str, Any], dict[str, bytes]], None]) -> Path:
    """The backup with another manifest and other files."""
    with zipfile.ZipFile(stored) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    manifest = json.loads(files.pop(MANIFEST))
    change(manifest, files)
    path = stored.with_name("changed.ps4backup")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
        archive.writestr(MANIFEST, json.dumps(manifest))
    return path


def named(name: str) -> Callable[[dict[str, Any], dict[str, bytes]], None]:
    """Give a file of the backup another name, in manifest and archive."""

    def change(manifest: dict[str, Any], files: dict[str, bytes]) -> None:
        manifest["files"][0]["path"], old = name, manifest["files"][0]["path"]
        files[name] = files.pop(old)

    return change


def without_a_file(_: dict[str, Any], files: dict[str, bytes]) -> None:
    files.popitem()


def another_content(_: dict[str, Any], files: dict[str, bytes]) -> None:
    name = next(iter(files))
    files[name] = bytes(len(files[name]))


def longer_content(_: dict[str, Any], files: dict[str, bytes]) -> None:
    files["results.sqlite"] += b"more"


def a_later_version(manifest: dict[str, Any], _: dict[str, bytes]) -> None:
    manifest["version"] = 3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (named("../outside"), "not the name of a file inside"),
        (named("/outside"), "not the name of a file inside"),
        (named("parts/../../outside"), "not the name of a file inside"),
        (named("results.sqlite/inside"), "cannot be written"),
        (named("a/" * 1500 + "b"), "cannot be used"),
        (without_a_file, "its files are not those of its manifest"),
        (another_content, "is not the file that was stored"),
        (longer_content, "results.sqlite is not the file that was stored"),
        (a_later_version, "its manifest cannot be used: version"),
    ],
)
def test_a_backup_that_was_altered_is_refused_and_nothing_is_made(
    stored: Path, tmp_path: Path, change: Any, said: str
) -> None:
    before = {path.name for path in tmp_path.iterdir()} | {"changed.ps4backup"}
    with pytest.raises(InputError, match=said):
        restore(rewritten(stored, change), tmp_path / "again")
    assert {path.name for path in tmp_path.iterdir()} == before


def test_every_damaged_byte_of_a_short_backup_is_noticed_or_harmless(
    line: Path, tmp_path: Path
) -> None:
    shutil.rmtree(line / "parts")
    (line / "results.sqlite").unlink()
    path = back_up(line, tmp_path / "short.ps4backup")
    good, content = files_of(restore(path, tmp_path / "good")), bytearray(path.read_bytes())
    # The end has the offset of the list of files.
    for position in (*range(0, len(content), 97), *range(len(content) - 6, len(content))):
        damaged = bytearray(content)
        damaged[position] ^= 0x55
        (tmp_path / "damaged.ps4backup").write_bytes(damaged)
        again = tmp_path / "again"
        try:
            assert files_of(restore(tmp_path / "damaged.ps4backup", again)) == good
        except InputError:
            assert not again.exists()
        else:
            shutil.rmtree(again)


def test_a_file_that_is_no_backup_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.ps4backup"
    path.write_text("notes")
    with pytest.raises(InputError, match="not a backup of a station"):
        restore(path, tmp_path / "again")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("notes.txt", "notes")
    with pytest.raises(InputError, match="not a backup of a station"):
        restore(path, tmp_path / "again")


def test_a_station_before_its_first_run_has_a_backup(tmp_path: Path, ps4rig: Any) -> None:
    assert ps4rig("station", "init", tmp_path / "line-1").exit_code == 0
    made = ps4rig("station", "backup", tmp_path / "line-1", tmp_path / "b.ps4backup")
    assert (made.exit_code, made.stdout.count("\n")) == (0, 1)
    done = ps4rig("station", "restore", tmp_path / "b.ps4backup", tmp_path / "again")
    assert "station line-1 of 2" in done.stdout
    assert "0 parts, 0 sets" in done.stdout
    assert StationFolder(tmp_path / "again").config == StationFolder(tmp_path / "line-1").config


def test_a_small_backup_with_a_large_manifest_is_refused(stored: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(stored) as archive:
        manifest = json.loads(archive.read(MANIFEST))
    manifest["missing"] = ["" for _ in range(1_000_000)]
    path = tmp_path / "large.ps4backup"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(MANIFEST, json.dumps(manifest))
    assert path.stat().st_size < 100_000
    with pytest.raises(InputError, match="compressed, or too large"):
        restore(path, tmp_path / "again")
