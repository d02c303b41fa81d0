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
