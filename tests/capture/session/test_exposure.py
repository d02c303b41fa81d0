"""The search for an exposure ends at the longest that fits into a frame."""

import pytest

from capture.session.exposure import find_exposure_ms
from rig import RigConfig


@pytest.mark.parametrize(("frame_rate_hz", "longest_ms"), [(30.0, 33.333), (60.0, 16.666)])
def test_a_dark_specimen_gets_the_longest_exposure(frame_rate_hz: float, longest_ms: float) -> None:
    config = RigConfig().with_changes(
        camera={
            "width_px": 64,
            "height_px": 64,
            "frame_rate_hz": frame_rate_hz,
            "exposure_ms": 4.0,
        },
        simulation={"ambient": 0.0, "led_levels": (0.02,) * 4},
    )
    assert find_exposure_ms(config) == longest_ms
