"""Lower bounds find the same nearest references with a fraction of the comparisons."""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import Match, TextureLibrary
from classify.classifiers import Comparison, classifier_named
from classify.library.match import FIRST_COUNT, MAX_CANDIDATES, match_of, nearest_references
from classify.texture.heading import HEADING_FLOATS
from classify.texture.orientation import HARMONICS
from classify.texture.spectra import RADII

SEEDS = st.integers(0, 2**32 - 1)
KEPT, LOST = 12, 6  # numbers that the bounds see, and that only the comparison sees


@dataclass
class Points:
    """References that are points; distances are squared Euclidean ones over a divisor."""

    points: npt.NDArray[np.float32]
    labels: list[str]
    divisor: float = 1.0
    compared: int = field(default=0)

    @property
    def classes(self) -> npt.NDArray[np.intp]:
        return np.unique(self.labels, return_inverse=True)[1]

    def bounds(self, test: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
        squares = np.square(self.points[:, :KEPT].astype(np.float64) - test[:KEPT]).sum(axis=1)
        return squares / self.divisor

    def distances(self, test: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
        squares = np.square(self.points.astype(np.float64) - test).sum(axis=1)
        return squares / self.divisor

    def match(self, test: npt.NDArray[np.float32]) -> Match:
        """The match by bounds."""
        everything = self.distances(test)

        def compare(indices: npt.NDArray[np.intp]) -> Comparison:
            self.compared += len(indices)
            return Comparison(everything[indices], indices % 180.0, indices / 1e6)

        chosen, found = nearest_references(self.classes, self.bounds(test), compare)
        assert (np.diff(chosen) > 0).all()
        np.testing.assert_array_equal(found.distances, everything[chosen])
        np.testing.assert_array_equal(found.orientations_deg, chosen % 180.0)
        np.testing.assert_array_equal(found.sharpness, chosen / 1e6)
        return match_of(found, [self.labels[i] for i in chosen], np.zeros(len(chosen)), {}, {})

    def exhaustive(self, test: npt.NDArray[np.float32]) -> Match:
        index = np.arange(len(self.labels))
        found = Comparison(self.distances(test), index % 180.0, index / 1e6)
        return match_of(found, self.labels, np.zeros(len(index)), {}, {})


def clustered(seed: int, count: int, classes: int, spread: float, level: float) -> Points:
    """Points about one centre for each class, at `level` from the origin.

    The bounds see most of what sets the centres apart.
    """
    rng = np.random.default_rng(seed)
    centres = rng.standard_normal((classes, KEPT + LOST)) + level
    centres[:, KEPT:] *= 0.1
    members = rng.integers(0, classes, count)
    points = centres[members] + spread * rng.standard_normal((count, KEPT + LOST))
    return Points(points.astype(np.float32), [f"class {member}" for member in members])


@settings(max_examples=60, deadline=None)
@given(
    SEEDS,
    st.integers(65, 3000),
    st.integers(1, 40),
    st.sampled_from([1e-4, 1e-2, 0.3, 1.0, 5.0]),
    st.sampled_from([0.0, 3.0, 100.0]),
    st.booleans(),
    st.sampled_from([1.0, 0.5, 3.0]),
)
def test_nearest_and_runner_up_are_those_of_comparing_everything(
    seed: int, count: int, classes: int, spread: float, level: float, known: bool, divisor: float
) -> None:
    """For clusters much narrower to wider than their distance."""
    library = clustered(seed, count, classes, spread, level)
    library.divisor = divisor
    rng = np.random.default_rng(seed ^ 1)
    test = library.points[rng.integers(count)] + spread * known * rng.standard_normal(KEPT + LOST)
    test = test.astype(np.float32)
    assert library.match(test) == library.exhaustive(test)


def test_thousands_of_members_of_one_class_do_not_hide_the_runner_up() -> None:
    """More references than are compared have lower bounds than the other class."""
    library = clustered(0, 12_000, 2, 0.05, 0.0)
    assert 2 * MAX_CANDIDATES < 12_000
    test = library.points[0]
    found = library.match(test)
    assert found == library.exhaustive(test)
    assert found.runner_up is not None
    assert library.compared < 500


def test_useless_bounds_do_not_lead_to_more_comparisons_than_allowed() -> None:
    library = clustered(4, 9000, 3, 1.0, 0.0)
    library.points[:, :KEPT] = 0.0
    test = library.points[11]
    library.match(test)
    assert library.compared <= MAX_CANDIDATES + 2 * FIRST_COUNT


def test_a_classifier_without_orientations_is_searched_too() -> None:
    library = clustered(6, 3000, 10, 1.0, 0.0)
    library.points[:, :KEPT] *= 0.1
    test = library.points[5] + np.float32(0.1)
    distances = library.distances(test)
    chosen, found = nearest_references(
        library.classes, library.bounds(test), lambda indices: Comparison(distances[indices])
    )
    assert len(chosen) > 4 * FIRST_COUNT  # there was a second round
    assert found.orientations_deg is None
    assert found.sharpness is None
    assert found.distances.min() == distances.min()


def test_a_reference_with_a_bound_of_nan_is_compared() -> None:
    """The numbers of a mapped library are not tested when it is loaded."""
    library = clustered(7, 3000, 10, 0.1, 0.0)
    test = library.points[2000]
    expected = library.exhaustive(test)
    bounds = library.bounds(test)
    bounds[2000] = np.nan
    distances = library.distances(test)
    chosen, found = nearest_references(
        library.classes, bounds, lambda indices: Comparison(distances[indices])
    )
    assert 2000 in chosen.tolist()
    assert found.distances.min() == expected.distance


JOINT = classifier_named("joint")
MAPS = 3 * RADII


def joint_signatures(
    seed: int, count: int, classes: int, spread: float, like: TextureLibrary
) -> tuple[npt.NDArray[np.float32], list[str]]:
    """Signatures that scatter about those of a real library."""
    rng = np.random.default_rng(seed)
    width = like.signatures.shape[1]
    scale = like.signatures[:, :-1].std()
    centres = like.signatures[rng.integers(0, len(like.labels), classes), :-1]
    centres = centres + 0.2 * scale * rng.standard_normal((classes, width - 1))
    # Classes differ in the power of their frequencies, in any direction.
    levels = np.s_[:, : 2 * HARMONICS * MAPS : 2 * HARMONICS]
    centres[levels] += 3.0 * scale * rng.standard_normal((classes, MAPS))
    members = np.arange(count) % classes
    signatures = np.empty((count, width), np.float32)
    signatures[:, :-1] = centres[members]
    signatures[:, :-1] += 0.2 * spread * scale * rng.standard_normal((count, width - 1))
    # Blur changes a class as it changes a real one, but for a little.
    statistics = len(like.parameters["whitening"])
    curve = slice(2 * HARMONICS * MAPS + statistics, -1 - HEADING_FLOATS)
    signatures[:, curve] = like.signatures[members % len(like.labels), curve]
    signatures[:, curve] *= rng.uniform(0.5, 1.5, (count, 1))
    size = signatures[0, curve].size
    signatures[:, curve] += 0.02 * spread * scale * rng.standard_normal((count, size))
    signatures[:, -1] = rng.uniform(0.4, 2.0, classes)[members]
    return signatures, [f"class {member}" for member in members]


@pytest.fixture(scope="module")
def trained(stationary) -> TextureLibrary:
    return TextureLibrary.train((k, stationary(k, seed=1)) for k in ("sand", "malv", "domes"))


@settings(max_examples=15, deadline=None)
@given(SEEDS, st.sampled_from([0.0, 1e-3, 0.1, 1.0]))
def test_no_joint_distance_is_below_its_bound(trained, seed: int, spread: float) -> None:
    signatures, _ = joint_signatures(seed, 60, 12, spread, trained)
    test = signatures[0] + np.float32(spread) * signatures[1]
    own, others = (JOINT.invariants(each, trained.parameters) for each in (test[None], signatures))
    bounds = JOINT.bounds(own[0], others, trained.parameters)
    distances = JOINT.compare(test, signatures, trained.parameters).distances
    energy = np.square(signatures[:, :-1]).sum(axis=1) / signatures[:, -1]
    assert (distances >= bounds - 2e-6 * energy).all()


@pytest.mark.parametrize("spread", [0.01, 0.2, 1.0])
def test_a_large_library_gives_the_match_of_comparing_all(trained, spread: float) -> None:
    signatures, labels = joint_signatures(11, 600, 60, spread, trained)
    everything = replace(
        trained,
        labels=tuple(labels),
        orientations_deg=np.arange(600.0) % 180.0,
        signatures=signatures,
        limits={},
    )
    library = replace(everything, compare_all_up_to=100)
    assert everything.invariants is None
    rng = np.random.default_rng(12)
    for index in rng.integers(0, 600, 6):
        noise = rng.standard_normal(signatures.shape[1]).astype(np.float32)
        test = signatures[index] + 0.1 * spread * noise
        expected, answer = everything.match(test), library.match(test)
        assert (answer.nearest, answer.runner_up) == (expected.nearest, expected.runner_up)
        assert answer.distance == pytest.approx(expected.distance, rel=1e-6, abs=1e-9)
        assert answer.runner_up_distance == pytest.approx(expected.runner_up_distance, rel=1e-6)
        assert answer.orientation_deg == pytest.approx(expected.orientation_deg, abs=1e-3)
    if spread < 1.0:
        assert len(library.candidates(test)[0]) < 300


def test_a_class_and_its_copy_make_a_surface_unknown(stationary, trained) -> None:
    """Equal references at equal distances, far apart in the library."""
    signatures, _ = joint_signatures(13, 150, 150, 1.0, trained)
    signatures[[3, 140]] = trained.signatures[0]
    labels = tuple(f"class {index}" for index in range(150))
    test = trained.observe(stationary("sand", 33.0, seed=2))
    for at_once in (1000, 100):
        library = replace(
            trained,
            labels=labels,
            orientations_deg=np.zeros(150),
            signatures=signatures,
            compare_all_up_to=at_once,
        )
        found = library.match(test)
        assert found.label is None
        assert (found.nearest, found.runner_up) == ("class 3", "class 140")
