"""The end of a run on a disk that another program has filled to the last byte."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from capture.session import folder as folder_module
from capture.session.events import Answer, SetCaptured
from capture.session.folder import TABLE, SessionFolder, session_folder
from capture.session.runner import run_session
from capture.sets import ome_tiff
from capture.sets.archive import JOURNAL
from classify.base import durable_file as durable
from classify.base import models
from classify.base.errors import InputError
from rig import RigConfig


class Disk:
    """A folder that holds no more than so many bytes, temporary files included."""

    def __init__(self, home: Path) -> None:
        self._home = home
        self.free_bytes: int | None = None
        self._used_bytes = 0

    def fill(self) -> None:
        """Take every free byte."""
        self.free_bytes, self._used_bytes = 0, self._held()

    def _held(self) -> int:
        return sum(path.stat().st_size for path in self._home.rglob("*") if path.is_file())

    @contextmanager
    def durable_file(self, path: Path, home: Path | None = None) -> Iterator[Path]:
        with durable.durable_file(path, home) as temporary:
            yield temporary
            if self.free_bytes is not None and self._held() > self._used_bytes:
                raise OSError(28, os.strerror(28))


@pytest.fixture
def disk(session: Path, monkeypatch: pytest.MonkeyPatch) -> Disk:
    disk = Disk(session)
    for module in (folder_module, models, ome_tiff):
        monkeypatch.setattr(module, "durable_file", disk.durable_file)
    return disk


def test_a_run_on_a_full_disk_ends_with_its_reason(
    session: Path, config: RigConfig, disk: Disk
) -> None:
    def fill(event: object) -> None:
        if isinstance(event, SetCaptured):
            disk.fill()

    with session_folder(session) as folder, pytest.raises(InputError, match="No space left"):
        run_session(folder, config, lambda _: Answer.GO, fill)
    done = SessionFolder(session)
    (run,) = done.journal.runs
    assert run.finish == "failed"
    assert run.reason is not None
    assert os.strerror(errno.ENOSPC) in run.reason
    assert len(done.missing()) == 3
    # With room again, the next run captures the rest.
    disk.free_bytes = None
    with session_folder(session) as folder:
        run_session(folder, config, lambda _: Answer.GO, lambda _: None)
        assert folder.missing() == []
    assert not (session / "session.reserve").exists()


def test_a_run_without_room_for_its_journal_does_not_begin(
    session: Path, config: RigConfig, disk: Disk
) -> None:
    disk.fill()
    with session_folder(session) as folder, pytest.raises(InputError, match=r"reserve: cannot be"):
        run_session(folder, config, lambda _: Answer.GO, lambda _: None)
    assert SessionFolder(session).journal.runs == ()


def test_the_reserve_covers_journal_and_table(session: Path, config: RigConfig) -> None:
    with session_folder(session) as folder:
        run_session(folder, config, lambda _: Answer.GO, lambda _: None)
        written = sum((session / name).stat().st_size for name in (JOURNAL, TABLE))
        folder.reserve()
    # Warnings make entries longer.
    assert (session / "session.reserve").stat().st_size > 64_000 + 1.4 * written
    assert written > 4 * 800
