"""Uniformity of surfaces that are a texture, and of some that are none."""

from collections.abc import Callable

import numpy as np
import pytest

from classify import SurfaceEstimate, TextureLibrary
from classify.classifiers.joint_learning import limit_factors
from classify.texture.fields import texture_fields
from classify.texture.uniformity import Uniformity, unevenness, uniformity_of, uniformity_remarks
from tests.classify.conftest import FIELDS

Make = Callable[..., SurfaceEstimate]


def uniformity(surface: SurfaceEstimate) -> Uniformity:
    return uniformity_of([unevenness(texture_fields(surface))])


def halves(left: SurfaceEstimate, right: SurfaceEstimate, contrast: float = 1.0) -> SurfaceEstimate:
    """A frame whose right half shows another surface."""
    p, q, albedo = (
        np.where(np.arange(left.shape[1]) < left.shape[1] // 2, ours, theirs)
        for ours, theirs in (
            (left.p, contrast * right.p),
            (left.q, contrast * right.q),
            (left.albedo, right.albedo),
        )
    )
    return SurfaceEstimate(p, q, albedo, left.valid, method=left.method)


@pytest.mark.parametrize("kind", FIELDS)
@pytest.mark.parametrize("size", [(64, 64), (128, 128), (256, 200), (96, 512)])
def test_a_texture_is_uniform_in_frames_of_any_size(
    stationary: Make, kind: str, size: tuple[int, int]
) -> None:
    rows, side = size
    found = uniformity(stationary(kind, seed=3, side=side, rows=rows))
    # A frame of 64 px has 16 pits, one in each piece.
    assert found == ("varied" if (kind, side) == ("pits", 64) else "uniform")


def test_two_textures_side_by_side_are_none(stationary: Make) -> None:
    sand, malv, rough = (stationary(kind, side=256) for kind in ("sand", "malv", "rough"))
    assert uniformity(halves(sand, rough)) == "no texture"
    assert uniformity(halves(malv, malv, contrast=0.25)) == "no texture"
    assert uniformity(halves(malv, malv, contrast=0.6)) == "varied"
    assert uniformity(halves(malv, malv, contrast=0.9)) == "uniform"


@pytest.mark.parametrize("place", [51, 102, 128])
def test_one_edge_is_not_uniform(surface_of: Make, place: int) -> None:
    """With noise, in relief and paint; also in the middle, where all quarters are alike."""
    p, q, albedo = 0.01 * np.random.default_rng(1).standard_normal((3, 256, 256))
    p[:, place : place + 3] += 0.8
    assert uniformity(surface_of(p, q, albedo + 0.5)) == (
        "varied" if place == 128 else "no texture"
    )
    albedo[:, place:] += 0.4
    assert uniformity(surface_of(p, q, albedo + 0.5)) != "uniform"


def test_noise_and_a_smooth_plate_are_uniform(surface_of: Make) -> None:
    flat = np.zeros((128, 128))
    noise = 0.05 * np.random.default_rng(2).standard_normal((3, 128, 128))
    assert unevenness(texture_fields(surface_of(flat, flat, flat + 0.5))) == 0.0
    assert uniformity(surface_of(noise[0], noise[1], 0.5 + noise[2])) == "uniform"


def test_contrast_exposure_and_rotation_change_little(stationary: Make, surface_of: Make) -> None:
    uneven = halves(stationary("malv", side=256), stationary("malv", side=256), contrast=0.5)
    usual = unevenness(texture_fields(uneven))
    turned = surface_of(-np.rot90(uneven.q), np.rot90(uneven.p), 2.0 * np.rot90(uneven.albedo))
    assert unevenness(texture_fields(turned)) == pytest.approx(usual, rel=0.02)


def test_sets_of_a_class_count_alike() -> None:
    assert uniformity_of([0.1, 0.7]) == "varied"
    assert uniformity_of([0.7, 0.7]) == "no texture"
    assert uniformity_of([0.1, 0.1, 0.3]) == "uniform"


def test_one_set_of_an_uneven_class_has_a_bounded_limit() -> None:
    """Until a second set shows how much the class varies."""
    labels = ("even", "varied", "none", "twice", "twice")
    kinds: dict[str, Uniformity] = {
        "even": "uniform", "varied": "varied", "none": "no texture", "twice": "varied"
    }  # fmt: skip
    factors = np.array([1.5, 1.5, 1.5, 1.5, 1.2], np.float32)
    found = limit_factors(labels, range(5), factors, kinds)
    np.testing.assert_allclose(found, [1.5, 1.3, 1.0, 1.5, 1.2])
    # References under rotated lights belong to one set.
    found = limit_factors(labels, (0, 1, 2, 3, 3), factors, kinds)
    np.testing.assert_allclose(found, [1.5, 1.3, 1.0, 1.3, 1.2])


def test_a_library_knows_its_classes(stationary: Make) -> None:
    picture = halves(stationary("sand", side=256), stationary("rough", side=256))
    library = TextureLibrary.train([("malv", stationary("malv")), ("picture", picture)])
    assert library.uniformity == {"malv": "uniform", "picture": "no texture"}
    (remark,) = uniformity_remarks(library.uniformity)
    assert remark.startswith("picture is no texture")
    match = library.classify(picture)
    assert (match.label, match.class_uniformity) == ("picture", "no texture")
    assert TextureLibrary.train([("malv", stationary("malv"))], "polar").uniformity == {}


def test_pictures_do_not_widen_the_unit_of_distance(stationary: Make) -> None:
    textures = [(kind, stationary(kind, side=256)) for kind in ("sand", "malv")]
    pictures = [
        (f"picture {kind}", halves(surface, surface, contrast=0.25)) for kind, surface in textures
    ]

    def distance_in(surfaces: list[tuple[str, SurfaceEstimate]]) -> float:
        """Distance from sand to malv in a library."""
        return TextureLibrary.train(surfaces).distances(textures[0][1])["malv"]

    assert distance_in(textures + pictures) == pytest.approx(distance_in(textures), rel=0.1)
    # Without a texture the pictures themselves give the unit.
    assert TextureLibrary.train(pictures).classify(pictures[0][1]).label == "picture sand"
