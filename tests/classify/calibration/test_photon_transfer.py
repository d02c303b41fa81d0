"""Gain and read noise from frames of a known sensor."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import CalibrationRejected
from classify.calibration.photon_transfer import BlockLevels, block_levels, photon_transfer

WELL_E, SIZE = 10_000.0, 128
LIGHTS = np.linspace(0.02, 0.9, 12)


def levels_of(
    bits: int, read_e: float, black: float, gamma: float = 1.0, seed: int = 0
) -> list[BlockLevels]:
    """Levels of four frames each of a sheet with fall-off, under several lights."""
    rng = np.random.default_rng(seed)
    full = 2.0**bits - 1.0
    sheet = np.linspace(0.6, 1.0, SIZE)[:, None] * np.linspace(0.8, 1.0, SIZE)
    found = []
    for light in LIGHTS:
        electrons = np.broadcast_to(light * WELL_E * sheet, (4, SIZE, SIZE))
        noise = np.sqrt(electrons + read_e**2) * rng.standard_normal(electrons.shape)
        share = np.clip(black + (1.0 - black) * (electrons + noise) / WELL_E, 0.0, 1.0)
        frames = np.rint(full * share ** (1.0 / gamma)).astype(np.uint8 if bits == 8 else np.uint16)
        found.append(block_levels(frames, full))
    return found


@settings(max_examples=6)
@given(st.sampled_from([8, 10, 12, 16]), st.floats(2.0, 40.0), st.integers(0, 2**32 - 1))
def test_gain_and_read_noise_are_within_four_standard_errors(
    bits: int, read_e: float, seed: int
) -> None:
    full, black = 2.0**bits - 1.0, 1 / 64
    found = photon_transfer(levels_of(bits, read_e, black, seed=seed), full * black, full)
    gain = WELL_E / full / (1.0 - black)
    sensor = found.noise.sensor
    assert found.gain_error < 0.02
    assert abs(sensor.gain_e_per_dn / gain - 1.0) < 4.0 * found.gain_error
    assert abs(sensor.read_noise_dn - read_e / gain) < 4.0 * found.read_noise_error_dn


@pytest.mark.parametrize("seed", range(3))
def test_rounding_of_an_evenly_lit_sheet_does_not_change_the_gain(seed: int) -> None:
    # All pixels of a block are rounded in the same way.
    rng = np.random.default_rng(seed)
    levels = []
    for light in 0.95 * 1.4 ** -np.arange(14.0):
        signal = np.full((4, SIZE, SIZE), light * WELL_E)
        signal += np.sqrt(signal + 25.0) * rng.standard_normal(signal.shape)
        levels.append(block_levels(np.rint(4.0 + 251.0 * signal / WELL_E).astype(np.uint8), 255.0))
    found = photon_transfer(levels, 4.0, 255.0)
    assert abs(found.noise.sensor.gain_e_per_dn * 251.0 / WELL_E - 1.0) < 4.0 * found.gain_error
    assert abs(found.noise.sensor.read_noise_dn - 0.1255) < 4.0 * found.read_noise_error_dn


def test_dark_noise_gives_the_read_noise_unless_rounding_hides_it() -> None:
    full = 4095.0
    levels = levels_of(12, 5.0, 1 / 64)
    known = photon_transfer(levels, full / 64, full, dark_noise_dn=2.2)
    assert known.noise.sensor.read_noise_dn == pytest.approx(np.sqrt(2.2**2 - 1 / 12))
    assert known.read_noise_error_dn is None
    hidden = photon_transfer(levels, full / 64, full, dark_noise_dn=0.3)
    assert hidden.noise == photon_transfer(levels, full / 64, full).noise


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("gamma", [0.5, 0.85, 1.15])
def test_a_camera_that_is_not_linear_is_refused(bits: int, gamma: float) -> None:
    with pytest.raises(CalibrationRejected, match="line in the mean"):
        photon_transfer(levels_of(bits, 5.0, 0.0, gamma), 0.0, 2.0**bits - 1.0)


@pytest.mark.parametrize(
    ("means", "variance_per_dn", "cause"),
    [
        ([np.linspace(5.0, 200.0, 99)] * 2, 0.0, "more bits"),
        ([np.full(9, level) for level in (20.0, 60.0, 120.0)], 0.4, "3 of 12 ranges"),
        ([np.full(99, 4.0)], 0.4, "too few levels"),
        ([np.full(9, np.nan)], 0.4, "too few levels"),
    ],
    ids=["hidden by rounding", "three levels", "without light", "clipped"],
)
def test_levels_without_a_line_are_refused(
    means: list[np.ndarray], variance_per_dn: float, cause: str
) -> None:
    levels = [BlockLevels(each, 0.05 + variance_per_dn * each, 0.0, 3000.0) for each in means]
    with pytest.raises(CalibrationRejected, match=cause):
        photon_transfer(levels, 4.0, 255.0)


def test_single_images_show_no_noise() -> None:
    frame = np.full((1, SIZE, SIZE), 900, np.uint16)
    with pytest.raises(CalibrationRejected, match="two images at one exposure"):
        photon_transfer([block_levels(frame, 4095.0)] * 6, 0.0, 4095.0)
