"""The dark part from frames of a known sensor, and frames that are not dark."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import CalibrationRejected, InputError
from classify.calibration.dark import dark_of, with_ambient
from classify.calibration.photon_transfer import block_levels

SHAPE = (96, 130)
FULL = 4095.0


def frames(
    offset: float = 64.0, noise: float = 2.0, pattern: float = 0.0, count: int = 16, seed: int = 0
) -> np.ndarray:
    rng = np.random.default_rng(seed)
    own = offset + pattern * rng.standard_normal(SHAPE)
    values = own + noise * rng.standard_normal((count, *SHAPE))
    return np.clip(np.rint(values), 0, FULL).astype(np.uint16)


@settings(max_examples=20)
@given(st.floats(20.0, 300.0), st.floats(0.6, 3.0), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_offset_noise_and_hot_pixels_are_found(
    offset: float, noise: float, hot: int, seed: int
) -> None:
    dark = frames(offset, noise, seed=seed)
    rng = np.random.default_rng(seed)
    places = np.unique(rng.integers(0, SHAPE, (hot, 2)), axis=0)
    dark[:, places[:, 0], places[:, 1]] += rng.integers(40, 3000, len(places)).astype(np.uint16)
    found = dark_of(dark, FULL)
    np.testing.assert_array_equal(found.dark.hot_pixels, places)
    assert found.dark.offset == pytest.approx(offset, abs=0.05)
    assert found.dark.noise == pytest.approx(np.hypot(noise, 12**-0.5), rel=0.02)
    assert found.fixed_pattern < 0.4
    assert not found.is_clipped


@pytest.mark.parametrize("pattern", [1.0, 3.0])
def test_the_fixed_pattern_is_told_from_noise(pattern: float) -> None:
    assert dark_of(frames(pattern=pattern), FULL).fixed_pattern == pytest.approx(pattern, rel=0.1)


def test_a_camera_that_clips_at_zero_is_noticed() -> None:
    clipped = dark_of(frames(offset=0.0, noise=1.0), FULL)
    assert clipped.is_clipped
    assert 0.5 < clipped.clipped < 0.8
    assert clipped.dark.hot_pixels.shape == (0, 2)


def test_an_even_dark_frame_has_no_noise() -> None:
    even = dark_of(np.zeros((2, *SHAPE), np.uint8), 255.0)
    assert (even.dark.offset, even.dark.noise, even.clipped) == (0.0, 0.0, 1.0)


def test_a_lit_room_is_not_dark() -> None:
    with pytest.raises(CalibrationRejected, match="not dark: 49%"):
        dark_of(frames(offset=2000.0), FULL)


@pytest.mark.parametrize("axis", [0, 1])
def test_light_beside_the_cover_shows_as_structure(axis: int) -> None:
    slope = np.linspace(0.0, 120.0, SHAPE[axis])
    leaky = frames() + (slope[:, None] if axis == 0 else slope).astype(np.uint16)
    with pytest.raises(CalibrationRejected, match="not evenly dark"):
        dark_of(leaky, FULL)


def test_too_many_hot_pixels_are_refused() -> None:
    dark = frames()
    dark[:, ::7, ::7] += 100
    with pytest.raises(CalibrationRejected, match=r"2\.1% .* hot"):
        dark_of(dark, FULL)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_an_led_visible_in_a_dark_frame_means_an_open_lens(seed: int) -> None:
    dark = frames(seed=seed)
    dark_of(dark, FULL, frames(count=4, seed=seed + 1))
    lit = frames(count=4, seed=seed + 1)
    lit[2, 30:60, 30:60] += 20
    with pytest.raises(CalibrationRejected, match="lens is not covered"):
        dark_of(dark, FULL, lit)


def test_ambient_light_is_that_above_the_offset() -> None:
    dark = frames()
    dark[:, 3, 4] += 1000
    found = dark_of(dark, FULL).dark
    image = np.full(SHAPE, 16 * 100, np.uint16)
    image[3, 4] = 65535  # of the hot pixel
    ambient = with_ambient(found, image, 16 * FULL).ambient
    assert ambient == pytest.approx(100.0 - found.offset)
    with pytest.raises(InputError, match="hot pixel lies outside"):
        with_ambient(found, image[:3], FULL)


@pytest.mark.parametrize("shape", [(16, 31, 64), (1, 64, 64), (64, 64)])
def test_frames_that_cannot_be_measured_are_an_input_error(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="frames"):
        dark_of(np.zeros(shape, np.uint8), 255.0)


def test_blocks_with_clipped_values_are_left_out() -> None:
    half = np.full((2, 64, 64), 100, np.uint8)
    half[:, :32] = 255
    levels = block_levels(half, 255.0)
    assert np.isnan(levels.means[:128]).all()
    np.testing.assert_array_equal(levels.means[128:], 100.0)
    assert levels.saturated == 0.5


def test_a_change_of_the_light_between_frames_is_no_noise() -> None:
    steady = np.random.default_rng(1).integers(90, 110, (64, 64))
    levels = block_levels(np.stack([steady, steady + 7]).astype(np.uint8), 255.0)
    np.testing.assert_allclose(levels.variances, 0.0, atol=1e-9)
