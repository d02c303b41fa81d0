"""Figures of production, in their quick form; `production.py` and `kills.py` have the long one.

PARTS=20000 pytest -s -m slow tests/capture/station/test_production.py -k memory
PARTS=2000 pytest -s -m slow tests/capture/station/test_production.py -k fault
python -m tests.capture.station.kills --kills 300
python -m tests.capture.station.kills --kills 50 --postgresql
"""

import gc
import os
import random
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from capture.station.events import Event, PartAnnounced
from capture.station.folder import StationFolder
from capture.station.results.store import open_store
from capture.station.simulated_parts import simulated_part
from capture.station.verdict import Decision
from capture.station.verification import verify_station
from classify.errors import Ps4rigError
from tests.capture.acquisition.test_fault_matrix import FAMILIES
from tests.capture.station.production import SMALL_RIG, run_parts, taught_station
from tests.capture.station.teaching_sets import SIDE_PX

ROOT = Path(__file__).parents[3]
# Growth of the resident memory over the last half of a run that still counts as flat. The cache of
# rendered scenes, 64 MB, is full after 50 parts of 256 px, or 600 of 64 px: in the first half.
FLAT_MB = 16.0
# Parts that share one plan of faults.
PARTS_OF_A_PLAN = 10


def asked(default: int) -> int:
    return int(os.environ.get("PARTS", default))


def resident_mb() -> float:
    text = Path("/proc/self/status").read_text()
    found = re.search(r"VmRSS:\s+(\d+) kB", text)
    assert found is not None
    return int(found[1]) / 1024


@pytest.mark.slow
@pytest.mark.parametrize("command", [["--kills", "6"]], ids=["SQLite"])
def test_a_killed_production_loses_and_doubles_nothing(command: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.capture.station.kills", *command],
        cwd=ROOT, capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_memory_and_open_files_stay_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Frames smaller than the taught ones end as ERROR: they show the loop without the judge."""
    parts, side_px = asked(120), int(os.environ.get("FRAME_PX", SIDE_PX))
    rig = SMALL_RIG.with_changes(camera={"width_px": side_px, "height_px": side_px})
    folder = taught_station(tmp_path / "line-1")
    seen: list[tuple[int, float, int]] = []

    def listen(event: Event) -> None:
        if isinstance(event, PartAnnounced) and event.result.number % (parts // 12) == 0:
            gc.collect()
            handles = len(list(Path("/proc/self/fd").iterdir()))
            seen.append((event.result.number, resident_mb(), handles))

    run_parts(folder, parts, listen, rig)
    with capsys.disabled():
        print("\nparts   memory in MB   open files")
        for number, memory_mb, handles in seen:
            print(f"{number:5}   {memory_mb:12.1f}   {handles:10}")
    half = len(seen) // 2
    assert seen[-1][1] - seen[half][1] < FLAT_MB
    # A set file and a journal of the database may be open at the moment.
    assert max(row[2] for row in seen[half:]) <= max(row[2] for row in seen[:half]) + 2
    assert [finding.said for finding in verify_station(folder) if finding.state != "good"] == []
    with open_store(str(folder / "results.sqlite"), "line-1") as store:
        assert store.counters().simulated.parts == parts


def random_plan(chance: random.Random) -> tuple[str, dict[str, Any]]:
    """One or two faults, as the fault matrix of captures draws them."""
    plan: dict[str, Any] = {"seed": chance.getrandbits(31)}
    names = []
    for family in chance.choices(list(FAMILIES), [1, 2, 2], k=chance.choice([1, 1, 2])):
        fault = FAMILIES[family](chance)
        plan[family] = [*plan.get(family, []), fault]
        names.append(fault["kind"])
    return " + ".join(sorted(names)), plan


@pytest.mark.slow
def test_no_fault_lets_a_wrong_part_pass(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Half of the parts have another texture. A plan that breaks the rig ends its run."""
    parts, folder = asked(100), taught_station(tmp_path / "line-1")
    config = folder / "station.toml"
    config.write_text(
        config.read_text().partition("[simulated_parts]")[0]
        + '[simulated_parts]\nsurfaces = ["rock"]\nothers = ["sand", "malv", "ogil"]\n'
        + "share_other = 0.5\nshare_defective = 0.0\n"
    )
    feed = StationFolder(folder).config.simulated_parts
    ends: Counter[str] = Counter()
    wrong: list[str] = []
    for number in range(parts // PARTS_OF_A_PLAN):
        name, plan = random_plan(random.Random(number))
        rig = SMALL_RIG.with_changes(simulation={"faults": plan})

        def listen(event: Event, name: str = name) -> None:
            if isinstance(event, PartAnnounced):
                result = event.result
                part = simulated_part(feed, result.number, SIDE_PX)
                truth = "other" if part.is_other else "good"
                ends[f"{truth}: {result.verdict.decision}"] += 1
                if part.is_other and result.verdict.decision is Decision.PASS:
                    wrong.append(f"{result.part_id} with {name}: {result.verdict.reason}")

        try:
            run_parts(folder, PARTS_OF_A_PLAN, listen, rig)
        except Ps4rigError:
            ends["the station did not become ready"] += 1
    with capsys.disabled():
        print("", *(f"{count:6} {end}" for end, count in sorted(ends.items())), sep="\n")
    assert wrong == []
    assert ends["good: PASS"] > 0


@pytest.mark.slow
def test_a_full_disk_makes_errors_and_loses_nothing(tmp_path: Path) -> None:
    command = ["unshare", "--user", "--map-root-user", "--mount", sys.executable, "-m",
               "tests.capture.station.full_disk", str(tmp_path)]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
