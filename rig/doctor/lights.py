"""Checks of an open light controller."""

from collections.abc import Iterator
from pathlib import Path

from firmware_sim import Clock
from firmware_sim.firmware import FIRMWARE_VERSION
from rig.config.lights import LightsConfig
from rig.lights.driver import LightController, measure_switch_latency

from .check import Check

# A timer in a USB chip (16 ms in an FTDI) or a loaded machine causes slower switches, which add to
# the time of each set.
_SLOW_SWITCH_MS = 10.0


def check_lights(
    lights: LightController,
    clock: Clock,
    config: LightsConfig,
    firmware_version: str = FIRMWARE_VERSION,
) -> Iterator[Check]:
    """Check identity, number of LEDs, watchdog and switch time; LEDs are lit and put out again."""
    yield _identity(lights, firmware_version)
    yield _led_count(lights, config)
    yield _watchdog(lights)
    yield _latency(lights, clock)


def _identity(lights: LightController, firmware_version: str) -> Check:
    controller = lights.identity
    finding = (
        f"{controller.model} {controller.serial_number} on {lights.port}, "
        f"firmware {controller.firmware_version}, protocol {controller.protocol_version}"
    )
    if controller.firmware_version != firmware_version:
        finding += f"; this program brings firmware {firmware_version}"
        return Check("light controller", "warning", finding, "ps4rig rig flash")
    return Check("light controller", "ok", finding)


def _led_count(lights: LightController, config: LightsConfig) -> Check:
    named = len(config.tilts_deg)
    finding = f"the controller has {lights.led_count}, lights.tilts_deg names {named}"
    if named > lights.led_count:
        return Check("LEDs", "fault", finding, "correct lights.tilts_deg, or the board's LED_PINS")
    return Check("LEDs", "ok", finding)


def _watchdog(lights: LightController) -> Check:
    if lights.trips_watchdog():
        return Check("watchdog", "ok", "an LED went out by itself when no command came")
    finding = "an LED stayed on although no command came"
    return Check("watchdog", "fault", finding, "renew the firmware with ps4rig rig flash")


def _latency(lights: LightController, clock: Clock) -> Check:
    switch = measure_switch_latency(lights, clock)
    finding = (
        f"median {switch.median_ms:.2f} ms, worst {switch.worst_ms:.2f} ms of {switch.switches}, "
        "from writing to acknowledge"
    )
    if switch.median_ms <= _SLOW_SWITCH_MS:
        return Check("switch latency", "ok", finding)
    # A port below /dev/serial/by-id is a link to the device that sysfs names.
    name = Path(lights.port).resolve().name
    advice = (
        "with an FTDI chip, lower its timer: "
        f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer; otherwise end other "
        "programs that load the machine"
    )
    return Check("switch latency", "warning", finding, advice)
