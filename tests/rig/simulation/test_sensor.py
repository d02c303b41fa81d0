"""The simulated sensor has the properties that it states."""

import numpy as np
import numpy.typing as npt
import pytest

from rig.simulation.sensor import SensorModel


def exposed(sensor: SensorModel, light_ms: float, seed: int = 1) -> npt.NDArray[np.float64]:
    flat = np.full((256, 256), light_ms, np.float32)
    return sensor.expose(flat, np.random.default_rng(seed)).astype(np.float64)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_pixels_have_the_bit_depth_and_saturate_at_its_maximum(bits: int) -> None:
    sensor = SensorModel(bit_depth=bits)
    pixels = sensor.expose(np.full((8, 8), 1000.0, np.float32), np.random.default_rng(0))
    assert pixels.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert (pixels == 2**bits - 1).all()


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_the_mean_is_proportional_to_the_light_above_the_black_level(bits: int) -> None:
    sensor = SensorModel(bit_depth=bits)
    for light_ms in (0.0, 1.0, 5.0, 20.0):
        expected = sensor.black_level_dn + light_ms * sensor.white_e_per_ms / sensor.gain_e_per_dn
        noise = np.sqrt(light_ms * 425.0 + 25.0) / sensor.gain_e_per_dn
        # Noise below half a step leaves the rounding of the converter in the mean.
        step = 0.5 if noise < 0.5 else 0.0
        assert exposed(sensor, light_ms).mean() == pytest.approx(
            expected, abs=5 * np.hypot(noise, 0.3) / 256 + step
        )


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_photon_transfer_is_a_line_of_slope_one_over_gain(bits: int) -> None:
    """Variance against mean signal: intercept read noise squared plus rounding, slope 1 / gain."""
    sensor = SensorModel(bit_depth=bits)
    frames = [(exposed(sensor, x, 1), exposed(sensor, x, 2)) for x in np.linspace(0.0, 20.0, 9)]
    means = np.array([(a + b).mean() / 2 - sensor.black_level_dn for a, b in frames])
    variances = np.array([(a - b).var() / 2 for a, b in frames])
    slope, intercept = np.polyfit(means, variances, 1, w=1 / (variances + 1.0))
    assert slope == pytest.approx(1.0 / sensor.gain_e_per_dn, rel=0.01)
    assert intercept == pytest.approx(sensor.read_noise_dn**2 + 1 / 12, rel=0.05)
    assert np.corrcoef(means, variances)[0, 1] > 0.9999


def test_dark_noise_is_not_clipped_at_zero() -> None:
    sensor = SensorModel()
    dark = exposed(sensor, 0.0)
    assert dark.min() > 0.0
    assert dark.mean() == pytest.approx(sensor.black_level_dn, abs=0.1)
    assert dark.std() == pytest.approx(np.hypot(sensor.read_noise_dn, 12**-0.5), rel=0.02)
