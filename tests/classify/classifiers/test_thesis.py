"""The classifiers of the thesis: 1D polar and radial spectra, 2D spectra."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import InputError, Lighting, SurfaceEstimate
from classify.classifiers import classifier_named
from classify.classifiers.thesis import PolarSpectra, first_light
from classify.texture.orientation import roll_angles
from classify.texture.spectra import ANGLES, RADII
from tests.angles import off_deg

POLAR, POLAR_RADIAL, IMAGE_POLAR, SPECTRA_2D, SPECTRA_2D_POWER = (
    classifier_named(name)
    for name in ("polar", "polar_radial", "image_polar", "spectra_2d", "spectra_2d_power")
)
OF_SURFACES = [POLAR, POLAR_RADIAL]
NAMES = {"ids": lambda each: each.name}


@pytest.fixture(scope="module")
def observed(texture):
    """Observations of grain by its orientation."""
    return {angle: POLAR.observe(texture("grain", angle, seed=1), 64) for angle in (0.0, 35.0)}


def test_signatures_are_sums_over_radius_and_angle(observed) -> None:
    magnitude = np.sqrt(observed[0.0].per_octave)
    polar = POLAR.signature(observed[0.0], {})
    np.testing.assert_allclose(polar, magnitude[0].sum(axis=0), rtol=1e-6)
    both = POLAR_RADIAL.signature(observed[0.0], {})
    assert both.shape == (2, ANGLES + RADII)
    np.testing.assert_allclose(both[:, :ANGLES], magnitude.sum(axis=1), rtol=1e-6)
    np.testing.assert_allclose(both[:, ANGLES:], magnitude.sum(axis=2), rtol=1e-6)
    for signature in (polar, both):
        assert signature.dtype == np.float32


@pytest.mark.parametrize("classifier", OF_SURFACES, **NAMES)
def test_the_orientation_of_a_rotated_surface_is_found(observed, classifier) -> None:
    still, rotated = (classifier.signature(observed[angle], {}) for angle in (0.0, 35.0))
    found = classifier.compare(rotated, np.stack([still, rotated]), {})
    assert off_deg(found.orientations_deg[0], 35.0) < 1.0
    assert off_deg(found.orientations_deg[1], 0.0) < 0.1
    # The orientation is refined between steps of the grid, the error of `polar` is not.
    assert found.distances[0] < 0.02
    assert found.distances[1] == pytest.approx(0.0, abs=1e-9)
    assert found.sharpness is None


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 89), st.integers(0, 2**32 - 1))
def test_polar_spectra_compare_as_by_brute_force(steps: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    test = rng.random(ANGLES).astype(np.float32)
    references = np.stack([np.roll(test, -steps), rng.random(ANGLES)]).astype(np.float32)
    found = POLAR.compare(test, references, {})
    for reference, distance in zip(references.astype(float), found.distances, strict=True):
        errors = [np.square(np.roll(test, -angle) - reference).sum() for angle in range(ANGLES)]
        energy = np.square(test, dtype=float).sum() + np.square(reference).sum()
        assert distance == pytest.approx(min(errors) / energy, abs=1e-9)
    assert off_deg(found.orientations_deg[0], 2.0 * steps) < 2.0


def test_radial_spectra_distinguish_frequencies(observed) -> None:
    """Polar spectra have the same sums over other frequencies."""
    power = observed[0.0].per_octave
    other = PolarSpectra(power[:, np.random.default_rng(0).permutation(RADII)])
    apart = {}
    for classifier in OF_SURFACES:
        one, two = (classifier.signature(each, {}) for each in (observed[0.0], other))
        apart[classifier.name] = classifier.compare(one, two[None], {}).distances[0]
    assert apart["polar"] == pytest.approx(0.0, abs=1e-9)
    assert apart["polar_radial"] > 0.05


@given(st.integers(0, 2**32 - 1))
def test_distances_lie_between_zero_and_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for classifier, shape in (
        (POLAR, (ANGLES,)),
        (POLAR_RADIAL, (2, ANGLES + RADII)),
        (SPECTRA_2D, (2, RADII, ANGLES)),
    ):
        test, *others = rng.random((4, *shape)).astype(np.float32) ** 3
        found = classifier.compare(test, np.stack([*others, 0 * test]), {})
        assert ((found.distances >= 0) & (found.distances <= 1 + 1e-6)).all()
        assert ((found.orientations_deg >= 0) & (found.orientations_deg <= 180)).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("classifier", [*OF_SURFACES, SPECTRA_2D], **NAMES)
def test_a_smooth_surface_equals_itself_and_no_texture(observed, classifier) -> None:
    textured = classifier.signature(observed[0.0], {})
    nothing = np.zeros_like(textured)
    found = classifier.compare(nothing, np.stack([nothing, textured]), {})
    assert found.distances[0] == 0.0
    assert found.distances[1] == pytest.approx(1.0)


def test_a_channel_that_is_empty_in_both_adds_no_distance(observed) -> None:
    """As the albedo of most parts is."""
    signature = POLAR_RADIAL.signature(observed[0.0], {}).copy()
    signature[1] = 0.0
    assert POLAR_RADIAL.compare(signature, signature[None], {}).distances[0] == (
        pytest.approx(0.0, abs=1e-9)
    )


def test_the_first_light_is_nearest_to_tilt_0(photographed, stationary) -> None:
    surface = photographed(stationary("malv", side=64))
    assert first_light(surface) == 0
    assert first_light(replace(surface, lighting=Lighting.ring(45.0, (90, 180, 270, 350)))) == 3
    assert first_light(replace(surface, lighting=Lighting.ring(45.0, (90, 180, 270)))) in (0, 2)
    assert first_light(replace(surface, lighting=None)) == 0


def test_a_surface_without_its_images_is_refused(texture) -> None:
    with pytest.raises(InputError, match="comes without its images"):
        IMAGE_POLAR.observe(texture("grain"), 64)


def test_an_image_is_compared_at_any_exposure(photographed, stationary) -> None:
    surface = photographed(stationary("sand", 20.0, seed=1))
    bright = IMAGE_POLAR.signature(IMAGE_POLAR.observe(surface, 64), {})
    dark = IMAGE_POLAR.observe(replace(surface, images=surface.images // 2), 64)
    np.testing.assert_allclose(IMAGE_POLAR.signature(dark, {}), bright, rtol=2e-3)


def test_slopes_rotate_with_the_surface_and_images_do_not(photographed, stationary) -> None:
    """Ripples along the light are nearly invisible in an image."""
    shares = []
    for classifier in (IMAGE_POLAR, POLAR):
        still, rotated = (
            classifier.signature(
                classifier.observe(photographed(stationary("malv", angle, seed=1)), 64), {}
            )
            for angle in (0.0, 90.0)
        )
        back = roll_angles(rotated, np.array([45.0]))[0]
        shares.append(np.square(back - still).sum() / np.square(still).sum())
    assert shares[0] > 5.0 * shares[1]


def signature(surface: SurfaceEstimate, scheme=SPECTRA_2D) -> np.ndarray:
    return scheme.signature(scheme.observe(surface, 64), {})


def compare(test: np.ndarray, references: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = SPECTRA_2D.compare(test, references, {})
    assert found.orientations_deg is not None
    return found.distances, found.orientations_deg


@pytest.fixture(scope="module")
def learned(texture) -> np.ndarray:
    return signature(texture("grain", seed=1))


def test_signatures_are_magnitudes_or_powers(surface_of, texture) -> None:
    """Double slopes double or quadruple M and leave A."""
    surface = texture("grain", seed=1)
    steeper = surface_of(2 * surface.p, 2 * surface.q, surface.albedo)
    for scheme, times in ((SPECTRA_2D, 2.0), (SPECTRA_2D_POWER, 4.0)):
        one, two = signature(surface, scheme), signature(steeper, scheme)
        # Some slopes reach the bound.
        np.testing.assert_allclose(two[0], times * one[0], rtol=0.05, atol=1e-4)
        np.testing.assert_array_equal(two[1], one[1])
    np.testing.assert_allclose(
        signature(surface) ** 2, signature(surface, SPECTRA_2D_POWER), rtol=1e-5
    )


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 180))
def test_the_orientation_of_a_rotated_signature_is_found(learned, orientation_deg: float) -> None:
    rotated = roll_angles(learned, np.array([-orientation_deg * ANGLES / 180.0]))[0]
    distances, orientations = compare(rotated.astype(np.float32), learned[None])
    assert off_deg(orientations[0], orientation_deg) < 0.5
    assert distances[0] < 0.01


def test_a_rough_channel_does_not_outweigh_a_smooth_one(learned) -> None:
    """The distance by A does not change when M is a thousand times stronger in both."""
    other = learned.copy()
    other[1] = learned[1][::-1]
    rough = np.array([1000, 1], np.float32)[:, None, None]
    plain, _ = compare(learned, other[None])
    rougher, _ = compare(rough * learned, (rough * other)[None])
    assert plain[0] > 0.05
    assert rougher[0] == pytest.approx(plain[0], rel=1e-3)
