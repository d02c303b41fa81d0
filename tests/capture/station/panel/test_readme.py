"""The clients of the README, run as they are printed there."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from capture.station.domain.users import Role
from tests.capture.station.panel.panels import RunningPanel

README = Path(__file__).parents[4] / "capture" / "station" / "panel" / "README.md"


def example(language: str) -> str:
    section = README.read_text(encoding="utf-8").partition("\n## The API\n")[2]
    [text] = re.findall(rf"```{language}\n(.*?)```", section.partition("\n## ")[0], re.DOTALL)
    return str(text)


def token_of(panel: RunningPanel) -> str:
    panel.until_ready()
    return panel.panel.tokens.add("mes", Role.OPERATOR)


def test_the_client_in_ten_lines_of_python_prints_a_verdict(
    panel: RunningPanel, tmp_path: Path
) -> None:
    text = example("python")
    assert len([line for line in text.splitlines() if line]) <= 10
    (tmp_path / "client.py").write_text(text)
    command = (sys.executable, tmp_path / "client.py", panel.url, token_of(panel))
    said = [subprocess.check_output(command, text=True, timeout=60) for _ in range(2)]
    part_id = panel.bench.rows()[0][0]
    assert said == 2 * [f"{part_id} PASS it is good\n"]  # the key is the same
    assert len(panel.bench.rows()) == 1


@pytest.mark.browser
def test_the_client_in_curl_prints_a_verdict(panel: RunningPanel) -> None:
    given = os.environ | {"STATION": panel.url, "TOKEN": token_of(panel)}
    run = subprocess.run(
        ("sh", "-e"), input=example("sh"), env=given, capture_output=True, text=True, timeout=60
    )
    assert run.returncode == 0, run.stderr
    assert '"part_id": "A-17"' in run.stdout
    assert '"verdict": "PASS"' in run.stdout
