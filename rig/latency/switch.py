"""Measure the time of a switch, from writing the command to its acknowledge."""

import statistics
from dataclasses import dataclass

from firmware_sim import Clock
from rig.lights.driver import LightController


@dataclass(frozen=True)
class SwitchLatency:
    """Median and worst time of a number of switches, on the rig's clock."""

    median_ms: float
    worst_ms: float
    switches: int


def measure_switch_latency(
    lights: LightController, clock: Clock, switches: int = 40
) -> SwitchLatency:
    """Switch through all LEDs and off, and leave them off."""
    times_ms = []
    try:
        for number in range(switches):
            led = number % (lights.led_count + 1)
            asked_s = clock.now_s()
            switch = lights.off() if led == lights.led_count else lights.select(led)
            times_ms.append(1e3 * (switch.acknowledged_s - asked_s))
    finally:
        lights.off()
    return SwitchLatency(statistics.median(times_ms), max(times_ms), switches)
