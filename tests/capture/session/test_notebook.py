"""The notebook of capture/README.md runs on the folder of a session."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from capture.session.events import without_questions
from capture.session.folder import make_session, session_folder
from capture.session.runner import run_session
from rig import RigConfig

from .conftest import PLAN

README = Path(__file__).parents[3] / "capture" / "README.md"


@pytest.mark.slow
def test_the_notebook_makes_a_table_and_a_figure(
    in_folder: Path,
    config: RigConfig,
    run_python: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    section = README.read_text(encoding="utf-8").split("### In a notebook")[1]
    found = re.search(r"```python\n(.*?)```", section, re.DOTALL)
    assert found is not None
    program = found[1]
    assert len([line for line in program.splitlines() if line]) <= 15
    (in_folder / "fabrics.toml").write_text(PLAN.replace('"stones"', '"fabrics"'))
    with session_folder(make_session(in_folder / "fabrics.toml")) as folder:
        run_session(folder, config, without_questions, lambda _: None)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    table = run_python(program).splitlines()
    assert table[0].split() == ["rms_p", "off_deg", "shadowed_share"]
    rows = {line.split()[0]: line.split()[1:] for line in table[2:]}
    assert set(rows) == {"rock-1", "sand-1"}
    assert 0.1 < float(rows["sand-1"][0]) < 1.0
    assert abs(float(rows["sand-1"][1])) < 2.0
    figure = (in_folder / "fabrics.svg").read_text()
    assert figure.startswith("<?xml")
    assert "rms slope to the right" in figure
