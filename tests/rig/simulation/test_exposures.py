"""Exposures that are triggered one by one, for as long as a station runs."""

import tracemalloc

import pytest

from firmware_sim import VirtualClock
from rig.simulation.exposures import Shutter, Triggered


def test_a_camera_that_is_triggered_for_months_takes_no_more_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rig.simulation.exposures.KEPT_STARTS", 256)
    clock = VirtualClock()
    exposures = Triggered(clock, Shutter(period_s=0.001, exposure_s=0.0005))

    def trigger(first: int, last: int) -> int:
        for number in range(first, last):
            at_s = clock.now_s()
            exposures.trigger()
            assert exposures.await_start(number, at_s)
            assert exposures.start_s(number) == at_s
            assert exposures.started(at_s) == number + 1
            clock.sleep_s(0.002)
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before_bytes = trigger(0, 300)
        assert trigger(300, 300 + 10 * 256) - before_bytes < 10_000
    finally:
        tracemalloc.stop()
    with pytest.raises(ValueError, match="exposure 0 is older"):
        exposures.start_s(0)
