"""A new solver or classifier is a file (here, an object in its place) and a row."""

import ast
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from classify import Lighting, TextureLibrary, photometric_stereo
from classify.classifiers import classifier_named
from classify.methods import CLASSIFIERS, SOLVERS, SolverRow, suits
from classify.solvers.linear import solve_least_squares
from tests.test_architecture import FILES, ROOT, parsed, text_of


def tables_in(path: Path, names: set[str]) -> list[str]:
    """Dictionaries and sets of a file that have most of some names, with their lines."""
    return [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for node in ast.walk(parsed(text_of(path)))
        if isinstance(node, ast.Dict | ast.Set | ast.List | ast.Tuple)
        for words in [{each.value for each in ast.walk(node) if isinstance(each, ast.Constant)}]
        if len(words & names) > len(names) / 2
    ]


@pytest.mark.parametrize("table", [SOLVERS, CLASSIFIERS])
def test_one_table_has_the_names(table: dict[str, object]) -> None:
    # The chapter has its own solvers, and titles of the classifiers that it shows.
    places = [place for path in FILES for place in tables_in(path, set(table))]
    (place,) = (place for place in places if not place.startswith("capture/chapter/"))
    assert place.startswith("classify/methods.py:")


def test_a_solver_is_found_by_its_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        sys.modules, "classify.solvers.again", SimpleNamespace(solve=solve_least_squares)
    )
    monkeypatch.setitem(SOLVERS, "again", SolverRow("again:solve", 3, 6))
    assert [suits("again", lights) for lights in (2, 3, 6, 7)] == [False, True, True, False]
    images = np.random.default_rng(1).uniform(0.2, 0.8, (4, 8, 8)).astype(np.float32)
    surface = photometric_stereo(images, Lighting.ring(45.0), "again")
    expected = photometric_stereo(images, Lighting.ring(45.0), "least_squares")
    assert surface.method == "again"
    np.testing.assert_array_equal(surface.p, expected.p)


def test_a_classifier_is_found_by_its_row(monkeypatch: pytest.MonkeyPatch, stationary) -> None:
    made = replace(classifier_named("polar"), name="other")
    monkeypatch.setitem(sys.modules, "classify.classifiers.other", SimpleNamespace(OTHER=made))
    monkeypatch.setitem(CLASSIFIERS, "other", "other:OTHER")
    surfaces = [(kind, stationary(kind, 0.0, seed=1, side=96)) for kind in ("sand", "malv")]
    library = TextureLibrary.train(surfaces, "other")
    assert library.classifier == "other"
    assert library.classify(stationary("malv", 20.0, seed=2, side=96)).nearest == "malv"
