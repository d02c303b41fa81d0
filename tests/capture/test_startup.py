"""The modules that ``--help`` loads, and the public names of the packages."""

from collections.abc import Callable
from typing import Any

import pytest

import capture
import classify
import rig

HELP = """
import sys
from typer.testing import CliRunner
from capture.cli import app
pages = [[], *([name] for name in sys.argv[1:])]
assert all(CliRunner().invoke(app, [*page, "--help"]).exit_code == 0 for page in pages)
print(*{name.split(".")[0] for name in sys.modules})
"""
HEAVY = {
    *("cv2", "distributed", "email", "hashlib", "matplotlib", "numba", "numpy", "pydantic"),
    *("scipy", "serial", "tifffile"),
}


def test_help_loads_no_large_module(run_python: Callable[..., str]) -> None:
    names = (
        "demo",
        "capture",
        "import",
        "solve",
        "train",
        "classify",
        "evaluate",
        "rig",
        "calibrate",
    )
    loaded = set(run_python(HELP, *names).split())
    assert {"typer", "capture", "classify"} <= loaded
    assert loaded & HEAVY == set()


@pytest.mark.parametrize("package", [capture, classify, rig])
def test_every_public_name_can_be_imported(package: Any) -> None:
    assert package.__all__
    for name in package.__all__:
        assert getattr(package, name) is not None
    assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError):
        _ = package.no_such_name
