"""Agreement over all orientations, with a library's nearest reference too."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify import Lighting, TextureLibrary, photometric_stereo
from classify.texture.orientation import (
    OrientationProfile,
    agreement_by_shift,
    harmonics,
    least_error,
)
from rig import synthetic_surface
from rig.scene.render import render_frame

DEGREES = np.arange(180)


def peaks(*at_deg: float) -> OrientationProfile:
    """Peaks of height 0.9 and a half-width of 8 degrees."""
    away = [np.abs((DEGREES - each + 90.0) % 180.0 - 90.0) for each in at_deg]
    return OrientationProfile(0.9 - 0.005 * np.min(away, axis=0) ** 2)


@given(st.floats(0.0, 179.99))
def test_the_best_orientation_lies_at_the_peak(at_deg: float) -> None:
    best_deg, agreement = peaks(at_deg).best()
    assert abs((best_deg - at_deg + 90.0) % 180.0 - 90.0) < 0.01
    assert agreement == pytest.approx(0.9, abs=1e-3)


@given(st.floats(0.0, 179.99), st.floats(-5.0, 5.0))
def test_the_nearer_of_two_equal_peaks_is_found(at_deg: float, off_deg: float) -> None:
    profile = peaks(at_deg, at_deg + 90.0)
    for peak_deg in (at_deg, at_deg + 90.0):
        near_deg, _ = profile.best(peak_deg + off_deg, 8.0)
        assert abs((near_deg - peak_deg + 90.0) % 180.0 - 90.0) < 0.01


def test_beside_a_peak_the_end_of_the_range_is_the_best() -> None:
    orientation_deg, agreement = peaks(40.0).best(60.0, 8.0)
    assert orientation_deg == 52.0
    assert agreement == pytest.approx(0.9 - 0.005 * 12.0**2)


@given(st.integers(0, 179))
def test_the_highest_agreement_is_the_sharpness_at_the_shift(shift: int) -> None:
    polar = np.random.default_rng(5).normal(size=(4, 180)).astype(np.float32)
    # Coarse waves: the series has 16 harmonics.
    polar = np.stack([np.convolve(np.tile(row, 3), np.ones(25), "same")[180:360] for row in polar])
    test, reference = harmonics(np.roll(polar, shift, axis=-1)), harmonics(polar)
    found = least_error(test, reference[None])
    agreement = agreement_by_shift(test, reference[None])
    assert agreement.shape == (1, 180)
    assert agreement[0].argmax() == shift == round(found.shifts_deg[0]) % 180
    assert agreement[0].max() == pytest.approx(found.sharpness[0], abs=1e-6)


@pytest.mark.parametrize("reference_deg", [0.0, 25.5])
def test_a_library_gives_the_profile_of_its_nearest_reference(reference_deg: float) -> None:
    lighting = Lighting.ring(45.0)

    def solved(name: str, orientation_deg: float):
        scene = render_frame(synthetic_surface(name, 1, 512), lighting, 128, orientation_deg)
        return photometric_stereo(scene.lights, lighting)

    library = TextureLibrary.train(
        [(name, solved(name, reference_deg), reference_deg) for name in ("sand", "weave")]
    )
    profile = library.orientation_profile(solved("sand", 70.0))
    assert profile is not None
    best_deg, agreement = profile.best()
    assert best_deg == pytest.approx(70.0, abs=1.5)
    assert agreement > 0.9
    # A weave looks the same after a quarter turn.
    profile = library.orientation_profile(solved("weave", 70.0))
    assert profile is not None
    _, here = profile.best(70.0, 8.0)
    _, quarter = profile.best(160.0, 8.0)
    assert here == pytest.approx(quarter, abs=0.03)
    _, between = profile.best(115.0, 8.0)
    assert between < here - 0.3


def test_a_classifier_without_orientation_has_no_profile() -> None:
    lighting = Lighting.ring(45.0)
    scene = render_frame(synthetic_surface("sand", 1, 512), lighting, 128)
    surface = photometric_stereo(scene.lights, lighting)
    library = TextureLibrary.train([("sand", surface, 0.0)], classifier="varma_zisserman")
    assert library.orientation_profile(surface) is None
