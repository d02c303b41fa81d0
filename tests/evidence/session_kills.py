"""A session whose program is killed again and again loses, doubles and damages nothing.

    python -m tests.evidence.session_kills [--quick]

200 kills over sessions of 30 textures at 18 orientations; --quick has 20 over sessions of 9 sets.
"""

import argparse
import csv
import random
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

from capture import CapturedSet
from capture.session.events import without_questions
from capture.session.folder import SessionFolder, make_session, session_folder
from capture.session.runner import run_session
from classify.base.threads import set_thread_count
from rig import load_config

from .limits import at_most
from .session_faults import plan_of

# A kill comes after up to so many new files, and so much later: longer than a set takes.
_MOST_FILES, _LATEST_S = 3, 0.3


def small_rig(folder: Path) -> Path:
    rig = folder / "rig.toml"
    rig.write_text('[lights]\nport = "simulated"\n[camera]\nwidth_px = 96\nheight_px = 96\n')
    return rig


def files_of(session: Path) -> int:
    return len(list((session / "sets").glob("*.ome.tif")))


def _damage(session: Path) -> tuple[int, int]:
    """Number of captured sets, and of contradictions of journal, table and files."""
    folder = SessionFolder(session)
    table = session / "sets.csv"
    text = table.read_text(encoding="utf-8").splitlines() if table.is_file() else []
    by_file = {row["file"]: row["pixels_sha256"] for row in csv.DictReader(text) if row["file"]}
    entries = [entry for entry in folder.journal.entries if entry.file]
    damaged, hashes = 0, set()
    for entry in entries:
        captured = CapturedSet.load(session / str(entry.file))  # checks both hashes
        stored = captured.metadata
        own = (stored.pixels_sha256, stored.specimen, stored.orientation_deg)
        damaged += own != (entry.pixels_sha256, entry.specimen, entry.orientation_deg)
        hashes.add(entry.pixels_sha256)
    damaged += len(entries) - len(hashes)  # a set is there twice
    # A kill between the journal and the table leaves the table one entry behind until the next run.
    damaged += len(entries) - len(by_file) not in (0, 1)
    damaged += len(set(by_file.values()) - hashes)
    return len(entries), damaged


def _resume(session: Path, rig: Path) -> None:
    """Go on with a session in a forked process, without the imports of a new one."""
    set_thread_count(1)
    with session_folder(session) as folder:
        run_session(folder, load_config(rig), without_questions, lambda _: None)


def main(arguments: Sequence[str]) -> int:
    """Print what was lost, doubled or damaged; return 1 if anything was."""
    parser = argparse.ArgumentParser(prog="session_kills")
    parser.add_argument("--quick", action="store_true")
    is_quick = parser.parse_args(arguments).quick
    least, textures, orientations = (20, 3, 3) if is_quick else (200, 30, 18)
    choice = random.Random(20260101)
    kills = rounds = damaged = lost = 0
    with tempfile.TemporaryDirectory() as folder:
        rig = small_rig(Path(folder))
        while kills < least:
            rounds += 1
            plan = Path(folder) / f"killed-{rounds}.toml"
            plan.write_text(plan_of(f"killed-{rounds}", textures, orientations))
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
                kills += process.exitcode == -signal.SIGKILL
                damaged += process.exitcode not in (0, -signal.SIGKILL)
                captured, contradictions = _damage(session)
                # The set in progress may have a file, and no entry yet.
                damaged += contradictions + (files_of(session) - captured not in (0, 1))
            captured, contradictions = _damage(session)
            damaged += contradictions
            lost += textures * orientations - captured
    print(f"{kills} kills over {rounds} sessions of {textures * orientations} sets")
    return int(not all([at_most("lost", lost, 0), at_most("doubled or damaged", damaged, 0)]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
