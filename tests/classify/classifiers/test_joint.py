"""The default classifier: recognition, rejection, orientation, rotated lights."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from classify import InputError, Lighting, TextureLibrary, photometric_stereo
from classify.classifiers import classifier_named, joint_features
from classify.classifiers.joint_features import CONTRAST_GAINS, spectral_series
from classify.library.training import observe
from classify.texture.spectra import ANGLES, RADII
from tests.angles import off_deg

JOINT = classifier_named("joint")
KINDS = ("sand", "fine sand", "brushed", "malv", "rough", "dyed", "domes", "pits")
DIRECTED = ("sand", "fine sand", "brushed")
ORIENTATIONS_DEG = (23.7, 58.0, 101.3, 142.0)


@pytest.fixture(scope="module")
def library(stationary) -> TextureLibrary:
    return TextureLibrary.train((kind, stationary(kind, seed=1)) for kind in KINDS)


@pytest.fixture(scope="module")
def tests(stationary):
    """(kind, orientation_deg, surface) of other patches, none at 90 degrees."""
    return [
        (kind, orientation_deg, stationary(kind, orientation_deg, seed=2 + seed))
        for kind in KINDS
        for seed, orientation_deg in enumerate(ORIENTATIONS_DEG)
    ]


@pytest.fixture(scope="module")
def signatures(library, tests):
    return [library.observe(surface) for _, _, surface in tests]


def test_other_patches_are_recognised_in_any_orientation(library, tests, signatures) -> None:
    for (kind, _, _), signature in zip(tests, signatures, strict=True):
        match = library.match(signature)
        assert match.label == kind
        assert match.distance < match.limit
        assert match.margin > 0.3


def test_orientations_of_directed_textures_are_right_to_a_degree(
    library, tests, signatures
) -> None:
    errors = [
        off_deg(library.match(signature).orientation_deg, orientation_deg)
        for (kind, orientation_deg, _), signature in zip(tests, signatures, strict=True)
        if kind in DIRECTED
    ]
    assert np.median(errors) < 1.0
    assert max(errors) < 4.0


def test_sharpness_separates_directed_from_undirected_textures(library, tests, signatures) -> None:
    sharpness = {kind: [] for kind in KINDS}
    for (kind, _, _), signature in zip(tests, signatures, strict=True):
        sharpness[kind].append(library.match(signature).sharpness)
    for kind in DIRECTED:
        assert min(sharpness[kind]) > 0.75
    for kind in ("malv", "rough", "domes", "pits"):
        assert max(sharpness[kind]) < 0.6
        assert np.median(sharpness[kind]) < 0.4


@pytest.mark.parametrize("left_out", KINDS)
def test_a_texture_that_was_not_learned_is_unknown(stationary, tests, left_out: str) -> None:
    known = TextureLibrary.train(
        (kind, stationary(kind, seed=1)) for kind in KINDS if kind != left_out
    )
    for kind, _, surface in tests[:: len(ORIENTATIONS_DEG)]:
        match = known.classify(surface)
        if kind == left_out:
            assert match.label is None
            assert match.nearest in KINDS
            assert match.distance > match.limit
            assert f"to {match.nearest} exceeds its limit" in match.reason
        else:
            assert match.label == kind


def test_twins_of_equal_spectrum_are_distinguished(stationary) -> None:
    """Pits and domes have one power spectrum; their local statistics differ."""
    library = TextureLibrary.train((kind, stationary(kind, seed=1)) for kind in ("domes", "pits"))
    spectra = TextureLibrary.train(
        ((kind, stationary(kind, seed=1)) for kind in ("domes", "pits")), "spectra_2d"
    )
    margins = []
    for kind in ("domes", "pits"):
        for seed in range(5, 9):
            surface = stationary(kind, 30.0 * seed, seed=seed)
            match = library.classify(surface)
            assert match.label == kind
            assert match.margin > 0.5
            margins.append(spectra.classify(surface).margin)
    assert np.median(margins) < 0.5


@pytest.mark.parametrize(("side", "most"), [(128, 32.0), (256, 8.0), (512, 8.0)])
def test_fine_rings_count_more_in_small_frames(stationary, side: int, most: float) -> None:
    parameters = TextureLibrary.train([("sand", stationary("sand", side=side))]).parameters
    white = np.ones((3, RADII, ANGLES), np.float32)
    rings = np.abs(spectral_series(white, parameters)[RADII : 2 * RADII, 0])  # of the albedo
    assert (rings[-1] / rings[0]) ** 2 == pytest.approx(most / 2.0, rel=0.01)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_limits_hold_in_libraries_of_few_classes(stationary, tests, count: int) -> None:
    """Few quarters scatter at random, so typical variances are averaged in."""
    for first in range(0, len(KINDS), 2):
        known = [KINDS[(first + i) % len(KINDS)] for i in range(count)]
        library = TextureLibrary.train((kind, stationary(kind, seed=1)) for kind in known)
        for kind, _, surface in tests[::2]:
            assert library.classify(surface).label == (kind if kind in known else None)


def test_a_class_with_a_figure_in_a_corner_does_not_accept_other_textures(stationary) -> None:
    """Its quarters differ more than textures do."""
    figure = stationary("malv", seed=1)
    corner = np.s_[:64, :64]
    for name in ("p", "q", "albedo"):
        getattr(figure, name)[corner] = getattr(stationary("sand", seed=1), name)[corner]
    kinds = ("fine sand", "brushed", "rough", "dyed")
    library = TextureLibrary.train(
        [("figure", figure), *((kind, stationary(kind, seed=1)) for kind in kinds)]
    )
    # Three quarters of it are malv.
    for kind in set(KINDS) - {"malv"}:
        match = library.classify(stationary(kind, 23.0, seed=2))
        assert match.label == (kind if kind in kinds else None)


def test_the_unit_of_distances_is_the_distance_between_quarters(library, signatures) -> None:
    """Another patch of any texture is at a distance of about 1."""
    assert set(library.limits) == set(KINDS)
    distances = [library.match(signature).distance for signature in signatures]
    assert all(0.05 < distance < 4.0 for distance in distances)
    assert 0.2 < np.median(distances) < 2.0


@pytest.mark.parametrize(("side", "rows"), [(64, 128), (96, 96), (200, 64), (256, 256)])
def test_frames_of_other_sizes_are_recognised(library, stationary, side: int, rows: int) -> None:
    """A smaller frame scatters more, and is not rejected for that."""
    for kind in ("sand", "brushed", "malv", "domes"):
        match = library.classify(stationary(kind, 61.0, seed=8, side=side, rows=rows))
        assert match.label == kind
        assert kind not in DIRECTED or off_deg(match.orientation_deg, 61.0) < 3.0


def test_training_observes_the_frame_like_a_test_and_its_quarters(stationary) -> None:
    surface = stationary("malv", seed=1)
    tested, trained = JOINT.observe(surface, 64), observe(surface, 64)
    np.testing.assert_array_equal(tested.polar, trained.frame.polar)
    np.testing.assert_array_equal(tested.statistics.moments, trained.frame.statistics.moments)
    assert len(trained.quarters) == 4
    assert trained.rotated == ()
    assert len(pickle.dumps(trained)) < 2**20


def test_a_change_of_contrast_counts_by_the_square_of_its_gain(library, stationary) -> None:
    """More power at all frequencies is a single difference."""
    parameters = {**library.parameters, "density_floor": np.array(1e-12)}
    equal = {**parameters, CONTRAST_GAINS: np.ones(3)}
    polar = observe(stationary("dyed", seed=1), library.segment_px).frame.polar
    reduced, full = (
        np.square(np.abs(spectral_series(2.0 * polar, each) - spectral_series(polar, each)))
        .reshape(3, -1)
        .sum(axis=1)
        for each in (parameters, equal)
    )
    assert full[:2].min() > 1.0
    np.testing.assert_allclose(reduced, library.parameters[CONTRAST_GAINS] ** 2 * full, atol=1e-3)


def test_textures_whose_quarters_differ_in_contrast_have_smaller_gains(stationary) -> None:
    def gains(scale: float) -> np.ndarray:
        surface = stationary("dyed", seed=1)
        p, q = surface.p.copy(), surface.q.copy()
        half = len(p) // 2
        p[:half] *= scale
        q[:half] *= scale
        trained = observe(replace(surface, p=p, q=q), 64)
        return JOINT.learn([trained] * 20, ["dyed"] * 20)[CONTRAST_GAINS]

    even, uneven = gains(1.0), gains(0.5)
    assert uneven[0] < 0.8 * even[0]
    assert uneven[1] == pytest.approx(even[1], rel=0.1)


@pytest.mark.parametrize("kind", ["sand", "malv"])
def test_additional_noise_does_not_make_a_texture_unknown(library, stationary, kind: str) -> None:
    """As of an 8-bit camera instead of one of 16 bits."""
    surface = stationary(kind, 66.0, seed=6)
    p, q, albedo = (
        np.random.default_rng(0).normal(0.0, 0.01, (3, *surface.shape)).astype(np.float32)
    )
    noisy = replace(surface, p=surface.p + p, q=surface.q + q, albedo=surface.albedo + 0.3 * albedo)
    assert library.classify(noisy).label == kind


@pytest.fixture(scope="module")
def low_light(stationary, photographed):
    """Make a surface from low lights, much in shadow: kind, orientation_deg, seed."""
    lighting = Lighting.ring(72.0)

    def make(kind: str, orientation_deg: float = 0.0, seed: int = 1):
        images = photographed(stationary(kind, orientation_deg, seed=seed), 72.0).images
        return photometric_stereo(images, lighting)

    return make


def test_a_surface_in_shadow_gives_references_for_rotated_lights(low_light) -> None:
    """They count in comparisons but not in the limits."""
    rows = [(kind, low_light(kind)) for kind in ("brushed", "rough")]
    assert all(surface.shadow_mask.mean() > 0.05 for _, surface in rows)
    library = TextureLibrary.train([(kind, surface, 30.0) for kind, surface in rows])
    plain = TextureLibrary.train([(k, replace(each, lighting=None), 30.0) for k, each in rows])
    assert plain.labels == ("brushed", "rough")
    assert library.classes == ("brushed", "rough")
    assert len(library.labels) > 2
    assert set(library.orientations_deg.tolist()) == {30.0}
    assert library.limits == pytest.approx(plain.limits)
    for kind in ("brushed", "rough"):
        for orientation_deg in (22.5, 45.0, 67.5):
            surface = low_light(kind, orientation_deg, seed=2)
            match = library.classify(surface)
            assert match.nearest == kind
            assert match.distance <= plain.classify(surface).distance * (1 + 1e-6)
    surface = low_light("brushed", 45.0, seed=2)
    assert off_deg(library.classify(surface).orientation_deg, 75.0) < 3.0


def test_a_frame_smaller_than_a_segment_is_refused_before_other_work(
    surface_of, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other threads would go on with it, and warn of empty windows after the error."""
    begun = []
    monkeypatch.setattr("classify.classifiers.joint_features.in_background", begun.append)
    flat = np.zeros((8, 8))
    with pytest.raises(InputError, match=r"8 x 8 px .* 64 px segments"):
        joint_features.observe(surface_of(flat, flat, flat + 0.5), 64)
    assert begun == []
