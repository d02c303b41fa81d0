"""Exposures that are triggered one by one, for as long as a station runs."""

import pytest

from firmware_sim import VirtualClock
from rig.simulation.camera import Shutter, Triggered
from tests.memory_growth import growth_bytes


def test_a_camera_that_is_triggered_for_months_takes_no_more_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rig.simulation.camera.KEPT_STARTS", 256)
    clock = VirtualClock()
    exposures = Triggered(clock, Shutter(period_s=0.001, exposure_s=0.0005))

    def trigger(first: int, last: int) -> None:
        for number in range(first, last):
            at_s = clock.now_s()
            exposures.trigger()
            assert exposures.await_start(number, at_s)
            assert exposures.start_s(number) == at_s
            assert exposures.count_started(at_s) == number + 1
            clock.sleep_s(0.002)

    assert growth_bytes(trigger, 0, 300, 300 + 10 * 256) < 10_000
    with pytest.raises(ValueError, match="exposure 0 is older"):
        exposures.start_s(0)
