"""The first commands of a station, and its example of SQL, run as they are printed."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from .results.parts import record_three_days

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "capture" / "station" / "README.md").read_text(encoding="utf-8")


def section(heading: str) -> str:
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


@pytest.mark.slow
def test_the_first_commands_make_a_running_line(tmp_path: Path) -> None:
    first_page = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"## A line with a PLC\n.*?```\n(.*?)```", first_page, re.S)[0]
    # Only two times differ, for speed on a busy machine. A run ends with 1 if a part did not pass.
    script = re.sub(r"^(ps4rig station run [^#\n]*).*", r"\1 || [ $? = 1 ]", commands, flags=re.M)
    script = script.replace(
        "\n",
        "\nsed -i 's/^timer_s = 2.0/timer_s = 0/; s/^\\(max_trigger_age_s\\) = 1.0/\\1 = 60/' "
        "line-3/station.toml\n",
        1,
    )
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-ec", script],
        cwd=tmp_path,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    last = done.stdout.splitlines()[-1]
    passed, failed, unknown, errors = map(
        int, re.findall(r"(\d+) (?:PASS|FAIL|UNKNOWN|ERROR)", last)
    )
    # Part 27 is of another texture.
    assert passed + failed + unknown == 10
    assert (passed >= 8, unknown >= 1, errors) == (True, True, 0)


def test_the_example_counts_verdicts_per_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    [example] = re.findall(r"```python\n(.*?)```", section("Results"), re.DOTALL)
    (tmp_path / "line-3").mkdir()
    record_three_days(tmp_path / "line-3" / "results.sqlite")
    (tmp_path / "example.py").write_text(example)
    monkeypatch.chdir(tmp_path)
    runpy.run_path("example.py")
    # Part 2 is a FAIL that a person overrode, part 5 is simulated.
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["2026-11-20 PASS 3", "2026-11-21 UNKNOWN 1"]
