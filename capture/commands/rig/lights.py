"""``ps4rig rig lights``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from capture.base.console import out, reported
from capture.commands import options

if TYPE_CHECKING:
    from rig import LightController

# Time between two checks that the LED is still on. With cycle, each LED is on for this time.
_CHECK_S = 1.0


@reported
def lights(
    led: Annotated[
        str, typer.Argument(metavar="LED", help="Its number, counted from 0, or cycle, or off.")
    ],
    level: Annotated[
        int, typer.Option(min=0, max=100, help="Brightness in percent.", metavar="PERCENT")
    ] = 100,
    rig: options.Rig = "rig.toml",
) -> None:
    """Light one LED, or with cycle one LED after the other, until Ctrl-C.

    The camera is not opened. All LEDs are out when the command has ended.
    """
    from rig import ConfigError
    from rig.config.rig import config_of
    from rig.rig import open_lights
    from rig.simulation.rig import Simulation

    if led not in ("cycle", "off") and not led.isdecimal():
        raise ConfigError(f"LED {led!r} is unknown; give a number, cycle or off")
    config = config_of(rig)
    simulation = None
    if config.is_simulated:
        # An LED stays on until Ctrl-C, so real time must pass.
        config = config.with_changes(simulation={"clock": "real"})
        simulation = Simulation(config)
    try:
        with open_lights(config, simulation) as opened:
            if led == "off":
                opened.put_out()
                out.print(f"all LEDs of {opened.identity.serial_number} are out")
                return
            leds = range(opened.led_count) if led == "cycle" else [int(led)]
            if leds[0] >= opened.led_count:
                raise ConfigError(
                    f"LED {led}: the controller has {opened.led_count}, counted from 0"
                )
            try:
                _hold(opened, leds, level)
            except KeyboardInterrupt:  # Ctrl-C is the normal end
                opened.put_out()
                out.print("all LEDs are out")
    finally:
        if simulation is not None:
            simulation.close()


def _hold(opened: LightController, leds: Sequence[int], level: int) -> NoReturn:
    """Light the LEDs, one at a time, until an interrupt."""
    from rig.signals import signals_held_back

    for led in leds:
        opened.set_level(led, level)
    while True:
        for led in leds:
            if opened.state().led != led:
                opened.select(led)
                with signals_held_back():  # an interrupted line would be printed twice
                    out.print(f"LED {led} is on at {level} %; Ctrl-C puts it out")
            time.sleep(_CHECK_S)
            opened.confirm(led)
