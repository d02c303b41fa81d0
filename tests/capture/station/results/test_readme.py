import re
import runpy
from pathlib import Path

import pytest

from .parts import record_three_days

README = Path(__file__).parents[4] / "capture" / "station" / "README.md"


def test_the_example_counts_verdicts_per_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    section = README.read_text(encoding="utf-8").partition("\n## Results\n")[2]
    results = section.partition("\n## ")[0]
    [example] = re.findall(r"```python\n(.*?)```", results, re.DOTALL)
    (tmp_path / "line-3").mkdir()
    record_three_days(tmp_path / "line-3" / "results.sqlite")
    (tmp_path / "example.py").write_text(example)
    monkeypatch.chdir(tmp_path)
    runpy.run_path("example.py")
    # Part 2 is a FAIL that a person overrode, part 5 is simulated.
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["2026-11-20 PASS 3", "2026-11-21 UNKNOWN 1"]
