"""Exposure starts that the rig derives from a simulated driver's time stamps."""

import numpy as np
import pytest

from rig import ConfigError, RigConfig, open_rig

PERIOD_MS, EXPOSURE_MS = 1000.0 / 30.0, 20.0


def late_by_ms(camera: dict[str, object], simulation: dict[str, object]) -> np.ndarray:
    """Reported minus true exposure start of 40 frames, ms."""
    size = {"width_px": 16, "height_px": 16}
    config = RigConfig().with_changes(camera=size | camera, simulation=simulation)
    with open_rig(config) as rig:
        # The first exposure starts at 0 s, when the camera is opened.
        frames = [rig.camera.read(1.0) for _ in range(40)]
    return np.array([1e3 * frame.exposure_start_s - PERIOD_MS * frame.sequence for frame in frames])


def test_by_default_the_reported_start_is_true() -> None:
    np.testing.assert_allclose(late_by_ms({}, {}), 0.0, atol=1e-6)


def test_a_late_stamp_is_taken_as_the_end_of_the_frame() -> None:
    late = late_by_ms({}, {"stamp_lag_ms": 24.0})
    np.testing.assert_allclose(late, 24.0 - PERIOD_MS - EXPOSURE_MS, atol=1e-6)


def test_a_measured_timing_is_used() -> None:
    measured = {
        "readout_ms": 8.0,
        "timestamp_offset_ms": 4.0,
        "timestamp_uncertainty_ms": 0.5,
        "timing_measured_at": "simulated 12 bit 16x16, 30 Hz, 20 ms",
    }
    late = late_by_ms(measured, {"stamp_lag_ms": 24.0, "readout_ms": 8.0})
    np.testing.assert_allclose(late, -0.5, atol=1e-6)


def test_jitter_adds_to_the_lag_and_is_reproducible() -> None:
    lag = {"stamp_lag_ms": 24.0, "stamp_jitter_ms": 3.0}
    late = late_by_ms({}, lag) - (24.0 - PERIOD_MS - EXPOSURE_MS)
    assert late.min() >= -1e-6
    assert 2.0 < np.ptp(late) <= 3.0
    np.testing.assert_array_equal(late_by_ms({}, lag), late_by_ms({}, lag))


def test_a_timing_measured_in_another_mode_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"set to 'simulated 12 bit 16x16"):
        late_by_ms({"timing_measured_at": "simulated 12 bit 16x16, 60 Hz, 10 ms"}, {})
