"""Examples in the docstrings of `classify`."""

import doctest
import importlib
import pkgutil

import pytest

import classify

MODULES = [
    "classify",
    *(module.name for module in pkgutil.walk_packages(classify.__path__, "classify.")),
]


@pytest.mark.parametrize("name", MODULES)
def test_examples_give_their_output(name: str) -> None:
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_the_public_functions_have_examples() -> None:
    finder = doctest.DocTestFinder()
    modules = map(importlib.import_module, MODULES)
    shown = {test.name for module in modules for test in finder.find(module) if test.examples}
    assert "classify.solvers.solver.photometric_stereo" in shown
    assert "classify.lighting.Lighting.ring" in shown
