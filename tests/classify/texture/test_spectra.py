"""Polar spectra: angles, frequencies, power, curl and co-spectrum."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import InputError, surface_spectra
from classify.texture.fields import texture_fields
from classify.texture.orientation import best_shift, roll_angles, squared_errors_by_shift
from classify.texture.spectra import ANGLES, RADII, field_spectra, image_spectrum, segment_for
from tests.angles import off_deg


def ripple(surface_of, frequency: float, angle_deg: float, shape=(128, 128), amplitude=0.2):
    """A wave of height, by the angle of its wave vector and its slope's amplitude."""
    rows, columns = shape
    x, y = np.arange(columns)[None, :], -np.arange(rows)[:, None]
    u, v = frequency * np.cos(np.radians(angle_deg)), frequency * np.sin(np.radians(angle_deg))
    wave = amplitude * np.cos(2 * np.pi * (u * x + v * y) + 0.7)
    return surface_of(wave * u / frequency, wave * v / frequency, 0.5 + 0.5 * wave)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.06, 0.42), st.floats(0, 180), st.sampled_from([(128, 128), (96, 200)]))
def test_a_wave_peaks_at_its_angle_and_frequency(surface_of, frequency, angle_deg, shape) -> None:
    spectra = surface_spectra(ripple(surface_of, frequency, angle_deg, shape))
    radii, angles_deg = spectra.radii_cpp, np.arange(ANGLES) * 180.0 / ANGLES
    for density in (spectra.gradient, spectra.albedo):
        row, column = np.unravel_index(density.argmax(), density.shape)
        bin_cpp = 1.0 / spectra.segment_px
        nearest = np.abs(radii - frequency).min()
        assert abs(radii[row] - frequency) <= nearest + 0.75 * bin_cpp
        off = off_deg(angles_deg[column], angle_deg)
        assert np.radians(off) * frequency <= 0.75 * bin_cpp + np.radians(1.0) * frequency


@pytest.mark.parametrize("orientation_deg", [7.0, 30.0, 45.0, 76.0, 90.0, 121.0, 165.0])
@pytest.mark.parametrize("kind", ["ripple", "grain"])
def test_rotating_a_patch_shifts_its_polar_spectrum(texture, kind, orientation_deg) -> None:
    """One segment is rotated about its middle; its circular window stays the same."""
    still = surface_spectra(texture(kind, 0.0, seed=1), segment_px=128)
    rotated = surface_spectra(texture(kind, orientation_deg, seed=1), segment_px=128)
    for before, after in zip(still.polar, rotated.polar, strict=True):
        shift = best_shift(squared_errors_by_shift(after, before[None]))[0]
        assert off_deg(shift * 180.0 / ANGLES, orientation_deg) < 1.0
    back = roll_angles(rotated.gradient, np.array([orientation_deg * ANGLES / 180.0]))[0]
    likeness = np.corrcoef(np.sqrt(np.abs(back)).ravel(), np.sqrt(still.gradient).ravel())[0, 1]
    assert likeness > 0.98
    for before, after in zip(still.radial, rotated.radial, strict=True):
        assert np.abs(after - before).sum() < 0.1 * before.sum()


def test_the_gradient_spectrum_of_an_even_texture_is_even(texture) -> None:
    """Although that of p alone contains cos^2."""
    polar = np.mean(
        [surface_spectra(texture("even", seed=s, side=256)).polar[0] for s in range(6)], axis=0
    )
    ripples = polar / polar.mean() - 1.0
    second_harmonic = 2 * np.abs(np.fft.rfft(ripples)[1]) / ANGLES
    assert second_harmonic < 0.2  # p alone would have 1


@pytest.mark.parametrize("segment_px", [32, 64, 65])
def test_a_mirrored_surface_has_the_mirrored_spectrum(surface_of, segment_px: int) -> None:
    """White noise tests the edge of the spectrum too."""
    p, q, albedo = np.random.default_rng(0).standard_normal((3, 80, 80)) * 0.1
    spectra = surface_spectra(surface_of(p, q, 1 + albedo), segment_px)
    flipped = surface_of(-p[:, ::-1], q[:, ::-1], 1 + albedo[:, ::-1])
    mirrored = surface_spectra(flipped, segment_px)
    order = -np.arange(ANGLES) % ANGLES
    np.testing.assert_allclose(mirrored.gradient[:, order], spectra.gradient, rtol=1e-2)
    np.testing.assert_allclose(mirrored.albedo[:, order], spectra.albedo, rtol=1e-2)


def test_polar_and_radial_spectra_are_integrals(texture) -> None:
    spectra = surface_spectra(texture("grain"))
    for density, polar, radial in zip(
        (spectra.gradient, spectra.albedo), spectra.polar, spectra.radial, strict=True
    ):
        assert polar.shape == (ANGLES,)
        assert radial.shape == spectra.radii_cpp.shape
        over_angle = radial.astype(float)
        np.testing.assert_allclose(over_angle, density.mean(axis=1) * np.pi, rtol=1e-4)
        over_both = np.trapezoid(over_angle, spectra.radii_cpp)
        assert polar.sum() * np.pi / ANGLES == pytest.approx(over_both, rel=0.01)


@pytest.mark.parametrize("kind", ["ripple", "grain", "even"])
def test_power_is_that_of_the_slopes(texture, kind) -> None:
    """The integral of M is the mean squared slope, of A the variance of albedo."""
    surface = texture(kind, seed=2, side=256)
    spectra = surface_spectra(surface)
    weights = 2.0 * spectra.radii_cpp  # r dr, and both halves of the plane
    of_m, of_a = (np.trapezoid(radial * weights, spectra.radii_cpp) for radial in spectra.radial)
    assert of_m == pytest.approx(np.mean(surface.p**2 + surface.q**2), rel=0.15)
    assert of_a == pytest.approx(np.var(surface.albedo / surface.albedo.mean()), rel=0.15)


def test_albedo_scale_and_overall_slope_do_not_matter(texture, surface_of) -> None:
    surface = texture("grain")
    spectra = surface_spectra(surface)
    other = surface_spectra(surface_of(surface.p, surface.q, 37.0 * surface.albedo))
    np.testing.assert_allclose(other.albedo, spectra.albedo, rtol=1e-3, atol=1e-9)
    np.testing.assert_array_equal(other.gradient, spectra.gradient)
    tilted = surface_spectra(surface_of(surface.p + 0.2, surface.q - 0.1, surface.albedo))
    np.testing.assert_allclose(tilted.gradient, spectra.gradient, rtol=1e-2, atol=1e-6)


@given(st.integers(64, 5000), st.integers(64, 5000))
def test_segment_is_a_power_of_two_of_at_most_half_the_frame(rows: int, columns: int) -> None:
    side = segment_for((rows, columns))
    assert side & (side - 1) == 0
    assert 32 <= side <= 256
    assert 2 * side <= min(rows, columns)
    assert side == 256 or 4 * side > min(rows, columns)


@pytest.mark.parametrize("shape", [(63, 200), (200, 63), (8, 8)])
def test_a_frame_too_small_for_a_texture_is_refused(surface_of, shape) -> None:
    flat = np.zeros(shape)
    with pytest.raises(InputError, match="too small"):
        surface_spectra(surface_of(flat, flat, flat + 1))


def test_a_frame_smaller_than_the_segments_asked_for_is_refused(texture) -> None:
    with pytest.raises(InputError, match="256 px segments"):
        surface_spectra(texture("grain"), segment_px=256)
    for side in (0, 16, 31):
        with pytest.raises(InputError, match="at least 32 px"):
            surface_spectra(texture("grain"), segment_px=side)


def test_a_smooth_plane_and_a_constant_image_have_no_spectrum(surface_of) -> None:
    ones = np.ones((80, 100))
    spectra = surface_spectra(surface_of(0.3 * ones, -0.1 * ones, 0.7 * ones))
    np.testing.assert_allclose(spectra.gradient, 0.0, atol=1e-10)
    np.testing.assert_allclose(spectra.albedo, 0.0, atol=1e-10)
    np.testing.assert_allclose(image_spectrum(np.full((64, 80), 200, np.uint8), 32), 0.0, atol=1e-9)


def coherence(spectra) -> np.ndarray:
    """Co-spectrum over the root of both powers, where these are large."""
    powers = spectra.relief * spectra.albedo
    strong = powers > 1e-3 * powers.max()
    return spectra.co_spectrum[strong] / np.sqrt(powers[strong])


@pytest.mark.parametrize("kind", ["ripple", "grain", "even"])
def test_slopes_of_a_relief_lie_along_their_waves(texture, kind: str) -> None:
    spectra = surface_spectra(texture(kind, 25.0, seed=1))
    # A window spreads a wave over bins in other directions.
    assert np.abs(spectra.gradient - spectra.relief).sum() < 0.05 * spectra.gradient.sum()
    assert 0.0 <= spectra.curl_density < 1e-3 * spectra.gradient.max()


def test_slopes_across_their_waves_are_curl(texture, surface_of) -> None:
    """Every slope rotated by 90 degrees in its place."""
    surface = texture("grain", 25.0, seed=1)
    spectra = surface_spectra(surface_of(-surface.q, surface.p, surface.albedo))
    assert spectra.relief.sum() < 0.05 * spectra.gradient.sum()


def test_half_of_white_noise_is_curl_and_its_density_is_the_variance(surface_of) -> None:
    p, q, albedo = 0.05 * np.random.default_rng(0).standard_normal((3, 512, 512))
    spectra = surface_spectra(surface_of(p, q, 1 + albedo), 64)
    assert spectra.curl_density == pytest.approx(0.05**2, rel=0.05)
    # Interpolated amplitudes of few averages are some per cent too small.
    assert spectra.relief.mean() == pytest.approx(0.05**2, rel=0.1)
    assert spectra.albedo.mean() == pytest.approx(0.05**2, rel=0.1)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_relief_is_a_part_of_the_gradient(surface_of, seed: int) -> None:
    p, q, albedo = np.random.default_rng(seed).standard_normal((3, 64, 80))
    spectra = surface_spectra(surface_of(p, q, 2 + 0.2 * albedo))
    assert (spectra.relief >= 0.0).all()
    assert (spectra.relief <= spectra.gradient * (1 + 1e-5)).all()
    within = np.sqrt(spectra.relief * spectra.albedo)
    assert (np.abs(spectra.co_spectrum) <= within * (1 + 1e-5)).all()
    for density in (spectra.gradient, spectra.albedo, spectra.relief, spectra.co_spectrum):
        assert density.shape == (RADII, ANGLES)
        assert density.dtype == np.float32


@pytest.mark.parametrize(("contrast", "sign"), [(0.3, 1.0), (-0.3, -1.0)])
@pytest.mark.parametrize("orientation_deg", [0.0, 40.0, 115.0])
def test_the_co_spectrum_is_positive_where_high_places_are_bright(
    surface_of, orientation_deg: float, contrast: float, sign: float
) -> None:
    rows, columns = np.mgrid[:128, :128]
    u, v = 0.1 * np.cos(np.radians(orientation_deg)), 0.1 * np.sin(np.radians(orientation_deg))
    phase = 2 * np.pi * (u * columns - v * rows) + 0.4
    height, along = np.cos(phase), -np.sin(phase)
    spectra = surface_spectra(surface_of(2 * u * along, 2 * v * along, 1 + contrast * height))
    np.testing.assert_allclose(coherence(spectra), sign, atol=0.05)
    # Bright slopes, a quarter of a wave from bright heights, give 0.
    sideways = surface_spectra(surface_of(2 * u * along, 2 * v * along, 1 + contrast * along))
    np.testing.assert_allclose(coherence(sideways), 0.0, atol=0.05)


def test_the_spectrum_of_an_image_is_that_of_paint(texture) -> None:
    surface = texture("grain", seed=1)
    image = (surface.albedo * 40_000).astype(np.uint16)
    expected = surface_spectra(surface, 64).albedo
    np.testing.assert_allclose(image_spectrum(image, 64), expected, rtol=0.02, atol=1e-8)
    darker = image_spectrum(image.astype(np.float32) / 7, 64)
    np.testing.assert_allclose(darker, image_spectrum(image, 64), rtol=1e-3, atol=1e-8)


def test_images_without_a_spectrum_are_refused() -> None:
    with pytest.raises(InputError, match="the image is black"):
        image_spectrum(np.zeros((64, 64), np.uint8), 32)
    with pytest.raises(InputError, match="64 px segments"):
        image_spectrum(np.ones((64, 63), np.uint8), 64)


def test_fields_have_the_spectra_of_their_surface(texture) -> None:
    """In segments of any size: quarters of a frame use smaller ones."""
    surface = texture("grain", seed=1)
    ours, theirs = surface_spectra(surface, 32), field_spectra(texture_fields(surface), 32)
    np.testing.assert_array_equal(ours.gradient, theirs.gradient)
    np.testing.assert_array_equal(ours.co_spectrum, theirs.co_spectrum)
    small = field_spectra(texture_fields(surface), 16)
    assert small.segment_px == 16
    assert np.isfinite(small.gradient).all()
