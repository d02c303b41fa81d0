import re
import runpy
import shutil
from pathlib import Path

import pytest

from capture.station.results.store import open_store

README = Path(__file__).parents[4] / "capture" / "station" / "README.md"
OLD = Path(__file__).parents[3] / "data" / "results" / "version-1.sqlite"


def test_the_example_counts_verdicts_per_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    section = README.read_text(encoding="utf-8").partition("\n## Results\n")[2]
    results = section.partition("\n## ")[0]
    [example] = re.findall(r"```python\n(.*?)```", results, re.DOTALL)
    (tmp_path / "line-3").mkdir()
    shutil.copy(OLD, tmp_path / "line-3" / "results.sqlite")
    open_store(str(tmp_path / "line-3" / "results.sqlite"), "line-1").close()
    (tmp_path / "example.py").write_text(example)
    monkeypatch.chdir(tmp_path)
    runpy.run_path("example.py")
    # Part 2 is a FAIL that a person overrode, part 5 is simulated.
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["2026-11-20 PASS 3", "2026-11-21 UNKNOWN 1"]
