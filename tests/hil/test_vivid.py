"""Our V4L2 layer on a real kernel: boots the guest once, then shows each of its checks.

The checks themselves are in `guest/vivid_checks.py`. Without QEMU they fail and say what to
install: a proof that was not run is no proof.
"""

import ast
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import pytest

from .machine import MachineError, run_in_guest

pytestmark = pytest.mark.slow

CHECKS = Path(__file__).parent / "guest" / "vivid_checks.py"
# One to stream from, one to disconnect, one to be there when the driver is unbound.
VIVID = "n_devs=3 node_types=0x1,0x1,0x1"
TIMEOUT_S = 600.0


def names_in(source: str) -> list[str]:
    """Names of all checks, those that are imported too."""
    names = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef):
            names.append(node.name)
        elif isinstance(node, ast.ImportFrom):
            names += [alias.name for alias in node.names]
    return [name for name in names if name.startswith("test_")]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, list[str]]:
    """What went wrong, for every case of every check that ran; an empty text is a pass."""
    shared = tmp_path_factory.mktemp("guest")
    pytest_there = ["-m", "pytest", "-p", "no:cacheprovider", "--color=no", "--tb=short"]
    checks = CHECKS.relative_to(Path(__file__).parents[2])
    try:
        console = run_in_guest(
            [sys.executable, *pytest_there, "--junitxml=/mnt/results.xml", str(checks)],
            modules=["vivid"],
            module_options=VIVID,
            shared=shared,
            timeout_s=TIMEOUT_S,
        )
    except MachineError as error:
        pytest.fail(str(error), pytrace=False)
    results = shared / "results.xml"
    assert results.exists(), f"the guest's tests did not run:\n{console}"
    found: dict[str, list[str]] = {}
    for case in ET.parse(results).iter("testcase"):
        name = case.attrib["name"].split("[")[0]
        wrong = [f"{case.attrib['name']}: {part.tag}\n{part.text}" for part in case]
        found.setdefault(name, []).append("\n".join(wrong))
    return found


@pytest.mark.parametrize("name", names_in(CHECKS.read_text(encoding="utf-8")))
def test_on_vivid(outcomes: Mapping[str, list[str]], name: str) -> None:
    assert name in outcomes, f"{name} did not run in the guest"
    wrong = [text for text in outcomes[name] if text]
    assert not wrong, "\n".join(wrong)
