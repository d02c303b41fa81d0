"""Figures of production. The commands of the long runs take their numbers as options.

python -m tests.evidence.station.endurance --parts 20000
python -m tests.evidence.station.faults --parts 2000
python -m tests.evidence.station.kills --kills 300
python -m tests.evidence.station.kills --kills 50 --postgresql
python -m tests.evidence.station.kills --kills 300 --panel
"""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# Productions that run at the same time.
LONG = {"endurance": ["--parts", "500"], "faults": ["--parts", "300"]}


@pytest.mark.parametrize(
    "options",
    [
        pytest.param(["--kills", "6"], id="SQLite", marks=pytest.mark.slow),
        # The server is killed with the tenth kill.
        pytest.param(
            ["--kills", "10", "--postgresql"], id="PostgreSQL", marks=pytest.mark.postgresql
        ),
        # Run, panel, PLC and server; each of them is killed at least once.
        pytest.param(
            ["--kills", "8", "--panel", "--seed", "1"], id="all", marks=pytest.mark.postgresql
        ),
    ],
)
def test_a_killed_production_loses_and_doubles_nothing(options: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.evidence.station.kills", *options],
        cwd=ROOT, capture_output=True, text=True, timeout=3600,
    )  # fmt: skip
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_memory_stays_flat_and_no_fault_lets_a_wrong_part_pass(
    show_figures: Callable[[str], None],
) -> None:
    runs = {
        name: subprocess.Popen(
            [sys.executable, "-m", f"tests.evidence.station.{name}", *options],
            cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
        for name, options in LONG.items()
    }  # fmt: skip
    try:
        for name, run in runs.items():
            printed, _ = run.communicate(timeout=7200)
            show_figures(f"{name}\n{printed}")
            assert run.returncode == 0, name
    finally:
        for run in runs.values():
            run.kill()


@pytest.mark.slow
def test_a_full_disk_makes_errors_and_loses_nothing(tmp_path: Path) -> None:
    command = ["unshare", "--user", "--map-root-user", "--mount", sys.executable, "-m",
               "tests.evidence.station.full_disk", str(tmp_path)]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=3600)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
