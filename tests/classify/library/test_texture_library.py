"""Training and matching, on random textures of known orientation."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from classify import InputError, LibraryError, Lighting, TextureLibrary, photometric_stereo
from classify.library.training import TrainingRow, common_lighting, observe
from tests.angles import off_deg

KINDS = ("sand", "fine sand", "brushed", "malv")


@pytest.fixture(scope="module")
def library(stationary) -> TextureLibrary:
    return TextureLibrary.train((kind, stationary(kind, seed=1)) for kind in KINDS)


def test_the_smallest_training_frame_sets_the_segments(stationary) -> None:
    library = TextureLibrary.train([
        ("a", stationary("sand", side=256)), ("b", stationary("malv", side=100))
    ])  # fmt: skip
    assert library.segment_px == 32


def test_orientations_refer_to_given_training_orientations(stationary) -> None:
    library = TextureLibrary.train([
        ("sand", stationary("sand", 30.0, seed=1), 30.0),
        ("sand", stationary("sand", 75.0, seed=2), 75.0 + 180.0),
        ("brushed", stationary("brushed", 20.0, seed=1), None),
    ])  # fmt: skip
    assert library.orientations_deg.tolist() == [30.0, 255.0, 0.0]
    sand, brushed = stationary("sand", 100.0, seed=3), stationary("brushed", 50.0, seed=1)
    assert off_deg(library.classify(sand).orientation_deg, 100.0) < 2.0
    assert off_deg(library.classify(brushed).orientation_deg, 30.0) < 2.0


def test_the_given_orientations_of_a_class_hold_for_its_other_sets(stationary) -> None:
    """In any order of the sets: 0 for the first one would contradict the 100 of the second."""
    sets = [(0.0, None), (40.0, 100.0), (40.0, None)]
    rows = [
        ("brushed", stationary("brushed", angle, seed=1, side=96), given) for angle, given in sets
    ]
    library = TextureLibrary.train([*rows, ("other", stationary("sand", seed=1, side=96))])
    for found, angle in zip(library.orientations_deg, (60.0, 100.0, 100.0), strict=False):
        assert off_deg(found, angle) < 2.0
    assert library.oriented == ("brushed",)


def test_the_nearest_of_several_sets_of_a_class_counts(stationary) -> None:
    """For a texture that no single set shows completely."""
    rough, malv = (stationary(kind, seed=1) for kind in ("rough", "malv"))
    library = TextureLibrary.train(
        [("ground", rough), ("ground", malv), ("sand", stationary("sand", seed=1))]
    )
    for kind in ("rough", "malv"):
        surface = stationary(kind, 45.0, seed=8)
        match = library.classify(surface)
        assert (match.label, match.runner_up) == ("ground", "sand")
        alone = [
            replace(library, labels=(label,), signatures=signature[None]).classify(surface).distance
            for label, signature in zip(library.labels, library.signatures, strict=True)
        ]
        assert match.distance == pytest.approx(min(alone[:2]), rel=1e-6)
        assert match.distance < 0.5 * max(alone[:2])


def test_the_order_of_training_sets_changes_the_orientations_only(stationary) -> None:
    sets = [("sand", 0.0, 1), ("sand", 40.0, 2), ("malv", 0.0, 1), ("malv", 9.0, 2)]
    sets.append(("brushed", 70.0, 1))
    rows = [(kind, stationary(kind, angle, seed=seed, side=96)) for kind, angle, seed in sets]
    libraries = [TextureLibrary.train(each) for each in (rows, rows[::-1])]
    for kind, rotated_deg in (("sand", 40.0), ("malv", None), ("brushed", 0.0)):
        surface = stationary(kind, 111.0, seed=9, side=96)
        one, other = (library.classify(surface) for library in libraries)
        assert (one.label, one.runner_up) == (other.label, other.runner_up) == (kind, one.runner_up)
        assert other.distance == pytest.approx(one.distance, rel=1e-4)
        assert other.limit == pytest.approx(one.limit, rel=1e-4)
        if rotated_deg is not None:
            apart_deg = one.orientation_deg - other.orientation_deg
            assert off_deg(apart_deg, rotated_deg) < 2.0


def test_sets_observed_elsewhere_make_the_same_library(library, stationary) -> None:
    """As other processes observe sets."""
    rows = [TrainingRow(kind, observe(stationary(kind, seed=1), 64)) for kind in KINDS]
    again = TextureLibrary.from_observations(
        rows, 64, simulated=True, sources=[("one.ome.tif", "ab12")]
    )
    np.testing.assert_array_equal(library.signatures, again.signatures)
    assert again.limits == library.limits
    assert (library.simulated, again.simulated) == (False, True)
    assert again.sources == (("one.ome.tif", "ab12"),)


def test_a_library_needs_samples(library) -> None:
    with pytest.raises(LibraryError, match="nothing to train on"):
        TextureLibrary.train([])
    with pytest.raises(LibraryError, match="nothing to train on"):
        TextureLibrary.from_observations([], 64)
    with pytest.raises(LibraryError, match="one training set"):
        replace(library, labels=())


@pytest.mark.parametrize("orientation_deg", [np.nan, np.inf])
def test_a_training_orientation_must_be_finite(stationary, orientation_deg: float) -> None:
    with pytest.raises(LibraryError, match=r"orientation .* malv"):
        TextureLibrary.train([("malv", stationary("malv", side=64), orientation_deg)])


def test_surfaces_that_cannot_be_matched_are_refused(library, stationary) -> None:
    with pytest.raises(InputError, match="64 px segments"):
        library.classify(stationary("malv", side=60))
    with pytest.raises(InputError, match="too small"):
        TextureLibrary.train([("malv", stationary("malv", side=63))])


@pytest.mark.filterwarnings("error")
def test_a_smooth_plate_is_a_class_like_any_other(stationary, surface_of) -> None:
    """A plate without relief, pattern and noise."""
    plate = surface_of(*(level * np.ones((128, 128)) for level in (0.0, 0.0, 0.5)))
    malv = stationary("malv", seed=1)
    library = TextureLibrary.train([("plate", plate), ("malv", malv)])
    assert library.classify(plate).label == "plate"
    assert library.classify(malv).label == "malv"
    assert library.classify(stationary("malv", 40.0, seed=2)).label == "malv"
    alone = TextureLibrary.train([("plate", plate)])
    assert alone.classify(plate).label == "plate"
    assert alone.classify(malv).label is None
    assert TextureLibrary.train([("malv", malv)]).classify(plate).label is None


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "value"),
    [("density_floor", -1.0), ("spectral_scatter", 0.0), ("whitening", 1e300), ("pixels", 1e300)],
)
def test_parameters_that_give_nan_say_so(library, stationary, name: str, value: float) -> None:
    wrong = {**library.parameters, name: np.full_like(library.parameters[name], value)}
    with pytest.raises(LibraryError, match="NaN or infinity; train"):
        replace(library, parameters=wrong).classify(stationary("malv"))


def test_a_library_has_the_lighting_that_its_sets_share(photographed, stationary) -> None:
    surface = stationary("malv", side=64)
    at_45, near_45, at_50 = (photographed(surface, slant) for slant in (45.0, 45.4, 50.0))
    assert TextureLibrary.train([("a", at_45), ("a", near_45)]).lighting == Lighting.ring(45.0)
    assert TextureLibrary.train([("a", at_45), ("b", at_50)]).lighting is None
    assert TextureLibrary.train([("a", at_45), ("b", surface)]).lighting is None
    assert common_lighting([None, Lighting.ring()]) is None
    assert common_lighting([Lighting.ring()]) == Lighting.ring()


def test_a_library_knows_whether_its_sets_were_solved_as_planar_parts(
    photographed, stationary, tmp_path: Path
) -> None:
    images = photographed(stationary("sand", side=64)).images
    distant, planar = (
        photometric_stereo(images, Lighting.ring(), planar=planar) for planar in (False, True)
    )
    for surface in (distant, planar):
        TextureLibrary.train([("sand", surface)]).save(tmp_path / "a.ps4lib")
        library = TextureLibrary.load(tmp_path / "a.ps4lib")
        assert library.planar == surface.planar
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert library.classify(surface).label == "sand"
        other = planar if surface is distant else distant
        with pytest.warns(
            UserWarning, match=rf"ps4_robust{' as planar parts' * other.planar}, the"
        ):
            library.classify(other)
    with pytest.raises(LibraryError, match=r"ps4_robust \(sand\), .* as planar"):
        TextureLibrary.train([("sand", distant), ("sand", planar)])


@pytest.mark.slow
def test_four_thousand_pixels_a_side(stationary, surface_of) -> None:
    library = TextureLibrary.train(
        (kind, stationary(kind, seed=1, side=512)) for kind in ("sand", "malv")
    )
    tile = stationary("sand", 30.0, seed=2, side=500)
    large = surface_of(*(np.tile(getattr(tile, name), (8, 8)) for name in ("p", "q", "albedo")))
    match = library.classify(large)
    assert match.label == "sand"
    assert off_deg(match.orientation_deg, 30.0) < 2.0


def test_textures_under_one_mask_are_not_taken_for_each_other(stationary) -> None:
    """Spectra of the whole masked frame accept them: the outline of the mask is in both."""
    y, x = np.mgrid[:300, :300] - 149.5
    gear_wheel = np.hypot(x, y) < 90.0 + 30.0 * np.sign(np.cos(12.0 * np.arctan2(y, x)))
    kinds = ("malv", "brushed")
    trained, tested = (
        {kind: stationary(kind, seed=seed, side=300).within(gear_wheel) for kind in kinds}
        for seed in (1, 2)
    )
    libraries = {kind: TextureLibrary.train([(kind, trained[kind])]) for kind in kinds}
    for kind in kinds:
        answers = {other: libraries[kind].classify(tested[other]).label for other in kinds}
        assert answers == {other: kind if other == kind else None for other in kinds}
