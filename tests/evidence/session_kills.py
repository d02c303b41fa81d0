"""A session whose program is killed again and again loses, doubles and damages nothing.

The figure of capture/README.md, 200 kills over one session of 30 textures at 18 orientations:
PS4RIG_KILLS=200 PS4RIG_TEXTURES=30 PS4RIG_ORIENTATIONS=18 pytest -s -m slow FILE
"""

import csv
import os
import random
import signal
import subprocess
import time
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path

import pytest

from capture import CapturedSet
from capture.session.events import without_questions
from capture.session.folder import SessionFolder, make_session, session_folder
from capture.session.runner import run_session
from classify.base.threads import set_thread_count
from rig import load_config

from .test_session_figures import ORIENTATIONS, TEXTURES, plan_of

KILLS = int(os.environ.get("PS4RIG_KILLS", "40"))
# A kill comes after up to so many new files, and so much later: longer than a set takes.
_MOST_FILES, _LATEST_S = 3, 0.3
Spawn = Callable[..., subprocess.Popen[str]]


def small_rig(folder: Path) -> Path:
    rig = folder / "rig.toml"
    rig.write_text('[lights]\nport = "simulated"\n[camera]\nwidth_px = 96\nheight_px = 96\n')
    return rig


def files_of(session: Path) -> int:
    return len(list((session / "sets").glob("*.ome.tif")))


def assert_whole(session: Path) -> int:
    """Assert that journal, table and files agree, and return the number of captured sets."""
    folder = SessionFolder(session)
    table = session / "sets.csv"
    text = table.read_text(encoding="utf-8").splitlines() if table.is_file() else []
    rows = list(csv.DictReader(text))
    by_file = {row["file"]: row for row in rows if row["file"]}
    entries = [entry for entry in folder.journal.entries if entry.file]
    hashes = set()
    for entry in entries:
        assert entry.file is not None
        captured = CapturedSet.load(session / entry.file)  # checks both hashes
        assert captured.metadata.pixels_sha256 == entry.pixels_sha256
        assert captured.metadata.specimen == entry.specimen
        assert captured.metadata.orientation_deg == entry.orientation_deg
        hashes.add(entry.pixels_sha256)
    assert len(hashes) == len(entries), "a set is there twice"
    # A kill between the journal and the table leaves the table one entry behind until the next run.
    assert len(entries) - len(by_file) in (0, 1)
    assert all(by_file[name]["pixels_sha256"] in hashes for name in by_file)
    return len(entries)


def _resume(session: Path, rig: Path) -> None:
    """Go on with a session in a forked process, without the imports of a new one."""
    set_thread_count(1)
    with session_folder(session) as folder:
        run_session(folder, load_config(rig), without_questions, lambda _: None)


@pytest.mark.slow
def test_a_killed_session_loses_the_set_in_progress_at_most(
    tmp_path: Path, spawn: Spawn, show_figures: Callable[[str], None]
) -> None:
    rig = small_rig(tmp_path)
    choice = random.Random(20260101)
    kills = rounds = 0
    while kills < KILLS:
        rounds += 1
        plan = tmp_path / f"killed-{rounds}.toml"
        plan.write_text(plan_of(f"killed-{rounds}", TEXTURES, ORIENTATIONS))
        session = make_session(plan)
        while SessionFolder(session).missing():
            process = get_context("fork").Process(target=_resume, args=(session, rig))
            process.start()
            wanted = files_of(session) + choice.randint(0, _MOST_FILES)
            while files_of(session) < wanted and process.is_alive():
                time.sleep(0.002)
            time.sleep(choice.uniform(0.0, _LATEST_S))
            process.kill()
            process.join()
            assert process.exitcode in (0, -signal.SIGKILL)
            kills += process.exitcode != 0
            # The set in progress may have a file, and no entry yet.
            assert files_of(session) - assert_whole(session) in (0, 1)
        done = spawn("session", "resume", session, "--rig", rig, "--yes")
        out, error = done.communicate(timeout=120)
        assert (done.returncode, error) == (0, ""), out
        assert assert_whole(session) == TEXTURES * ORIENTATIONS
    show_figures(
        f"{kills} kills over {rounds} sessions of {TEXTURES * ORIENTATIONS} sets: none lost"
    )
