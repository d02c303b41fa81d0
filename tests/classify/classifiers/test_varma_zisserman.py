"""The classifier of Varma and Zisserman."""

from dataclasses import replace

import numpy as np
import pytest

from classify import LibraryError, TextureLibrary
from classify.classifiers.varma_zisserman import TEXTONS_PER_CLASS

KINDS = ("malv", "domes")


@pytest.fixture(scope="module")
def surfaces(stationary, photographed):
    return {kind: photographed(stationary(kind, seed=1, side=96)) for kind in KINDS}


@pytest.fixture(scope="module")
def library(surfaces) -> TextureLibrary:
    return TextureLibrary.train(surfaces.items(), "varma_zisserman")


def test_every_image_of_a_training_set_is_a_reference(library) -> None:
    assert library.labels == ("malv",) * 4 + ("domes",) * 4
    assert library.classes == KINDS
    assert library.signatures.shape == (8, 2 * TEXTONS_PER_CLASS)
    np.testing.assert_allclose(library.signatures.sum(axis=1), 1.0, rtol=1e-5)
    assert library.parameters["textons"].shape == (2 * TEXTONS_PER_CLASS, 8)
    assert library.limits == {}


def test_a_test_is_one_image_without_an_orientation(library, surfaces) -> None:
    assert library.observe(surfaces["malv"]).shape == library.signatures.shape[1:]
    match = library.classify(surfaces["malv"])
    assert (match.label, match.runner_up) == KINDS
    assert match.distance == 0.0  # the image was a training image
    assert match.orientation_deg is None
    assert match.sharpness is None


def test_several_sets_of_a_class_make_one_dictionary(surfaces, stationary, photographed) -> None:
    more = [("malv", surfaces["malv"]), ("malv", photographed(stationary("malv", seed=9, side=96)))]
    library = TextureLibrary.train(more, "varma_zisserman")
    assert library.labels == ("malv",) * 8
    assert library.parameters["textons"].shape == (TEXTONS_PER_CLASS, 8)
    assert library.orientations_deg.tolist() == [0.0] * 8


def test_a_library_without_textons_is_refused(library) -> None:
    with pytest.raises(LibraryError, match=r"textons .*\(0, 8\)"):
        replace(library, parameters={"textons": np.empty((0, 8))})
