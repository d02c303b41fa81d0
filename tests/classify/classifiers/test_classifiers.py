"""Every classifier through the one interface: training, matching, saving."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from classify import CLASSIFIER_NAMES, InputError, SurfaceEstimate, TextureLibrary
from classify.classifiers import classifier_named
from classify.lighting import Lighting
from classify.methods import DEFAULT_CLASSIFIER, METHODS

KINDS = ("sand", "malv", "rough")
OF_IMAGES = {name for name in CLASSIFIER_NAMES if classifier_named(name).from_images}
OF_SURFACES = sorted(set(CLASSIFIER_NAMES) - OF_IMAGES)
SIDE = 96

every = pytest.mark.parametrize("name", CLASSIFIER_NAMES)


@pytest.fixture(scope="module")
def surface(stationary, photographed):
    """Make a surface with its images: kind, orientation_deg, seed."""

    def make(kind: str, orientation_deg: float = 0.0, seed: int = 1, slant_deg: float = 45.0):
        return photographed(stationary(kind, orientation_deg, seed=seed, side=SIDE), slant_deg)

    return make


@pytest.fixture(scope="module")
def libraries(surface) -> dict[str, TextureLibrary]:
    rows = [(kind, surface(kind)) for kind in KINDS]
    return {name: TextureLibrary.train(rows, name) for name in CLASSIFIER_NAMES}


def test_the_names_are_those_of_the_classifiers_in_their_order() -> None:
    assert [classifier_named(name).name for name in CLASSIFIER_NAMES] == list(CLASSIFIER_NAMES)
    assert DEFAULT_CLASSIFIER in CLASSIFIER_NAMES
    assert len(set(METHODS)) == len(METHODS)
    assert {"image_polar", "varma_zisserman"} == OF_IMAGES


def test_an_unknown_name_lists_the_names(surface) -> None:
    with pytest.raises(InputError, match=r"'dice'.* joint, "):
        classifier_named("dice")
    with pytest.raises(InputError, match="'dice'"):
        TextureLibrary.train([("a", surface("sand"))], "dice")


@every
def test_another_patch_in_another_orientation_is_recognised(libraries, surface, name: str) -> None:
    for kind in KINDS:
        # The images of a directed texture depend on its orientation.
        orientation_deg = 0.0 if name in OF_IMAGES else 37.0
        assert libraries[name].classify(surface(kind, orientation_deg, seed=5)).nearest == kind


@every
def test_a_library_gives_the_same_match_after_saving_and_loading(
    libraries, surface, tmp_path: Path, name: str
) -> None:
    libraries[name].save(tmp_path / "x.ps4lib")
    loaded = TextureLibrary.load(tmp_path / "x.ps4lib")
    assert loaded.classifier == name
    for kind in KINDS:
        patch = surface(kind, 37.0, seed=6)
        assert loaded.classify(patch) == libraries[name].classify(patch)


@pytest.mark.parametrize("name", sorted(OF_IMAGES))
@pytest.mark.parametrize(
    ("slant_deg", "tilts_deg"),
    [
        (40.0, (0, 90, 180, 270)),
        (50.0, (0, 90, 180, 270)),
        (45.0, (45, 135, 225, 315)),
        (45.0, (90, 180, 270, 0)),
        (45.0, (0, 90, 180)),
    ],
)
def test_images_under_other_lights_are_refused(
    libraries, surface, name: str, slant_deg: float, tilts_deg: tuple[int, ...]
) -> None:
    patch = surface("sand", slant_deg=slant_deg)
    lighting = Lighting.ring(slant_deg, tilts_deg)
    other = replace(patch, images=patch.images[: len(tilts_deg)], lighting=lighting)
    with pytest.raises(InputError, match="at slant 45") as caught:
        libraries[name].classify(other)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", OF_SURFACES)
def test_surfaces_are_compared_whatever_their_lighting(libraries, surface, name: str) -> None:
    for slant_deg in (30.0, 60.0):
        assert libraries[name].classify(surface("sand", slant_deg=slant_deg)).label == "sand"


@every
def test_lights_within_a_degree_or_unknown_are_accepted(libraries, surface, name: str) -> None:
    for lighting in (Lighting.ring(45.5), None):
        patch = replace(surface("sand"), lighting=lighting)
        assert libraries[name].classify(patch).nearest == "sand"


@every
def test_bad_surfaces_get_one_line(libraries, surface, name: str) -> None:
    library = libraries[name]
    patch = surface("sand")

    def corner(rows: int, columns: int) -> SurfaceEstimate:
        maps = {
            key: np.ascontiguousarray(getattr(patch, key)[:rows, :columns])
            for key in ("p", "q", "albedo", "valid")
        }
        return replace(patch, **maps, images=patch.images[:, :rows, :columns].copy())

    small, pixel = corner(40, 90), corner(1, 1)
    dark = replace(patch, albedo=0 * patch.albedo, images=0 * patch.images)
    bad = {"dark": dark, "pixel": pixel}
    if name in OF_SURFACES:
        bad["invalid"] = replace(patch, valid=0 * patch.valid > 0)
    for each in bad.values():
        with pytest.raises(InputError) as caught:
            library.classify(each)
        assert "\n" not in str(caught.value)
    # 40 x 90 px are enough for segments of 32 px, not for textons.
    if name == "varma_zisserman":
        with pytest.raises(InputError):
            library.classify(small)
    else:
        assert library.classify(small).nearest in KINDS
