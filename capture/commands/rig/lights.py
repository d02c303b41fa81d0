"""``ps4rig rig lights``."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from capture.commands import options
from capture.console import out, reported

if TYPE_CHECKING:
    from rig import LightController

__all__ = ["lights"]

# Time between two checks that the LED is still on, and time of each LED in turn.
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
    """Switch an LED by hand until Ctrl-C, or all LEDs in turn with cycle.

    The camera is not opened. The LEDs are out at the end, whatever ends the command.
    """
    from rig import ConfigError
    from rig.config.rig import config_of
    from rig.rig import open_lights
    from rig.simulation.rig import Simulation

    if led not in ("cycle", "off") and not led.isdecimal():
        raise ConfigError(f"LED {led!r} is unknown; give a number, cycle or off")
    config = config_of(rig)
    if config.is_simulated:
        # Somebody watches the LEDs, so real time must pass.
        config = config.with_changes(simulation={"clock": "real"})
    simulation = Simulation(config) if config.is_simulated else None
    try:
        with open_lights(config, simulation) as opened:
            if led == "off":
                opened.put_out()
                out.print(f"all LEDs of {opened.identity.serial_number} are out")
                return
            number = None if led == "cycle" else int(led)
            if number is not None and number >= opened.led_count:
                raise ConfigError(
                    f"LED {led}: the controller has {opened.led_count}, counted from 0"
                )
            try:
                _hold(opened, number, level)
            except KeyboardInterrupt:  # the ordinary end
                opened.put_out()
                out.print("all LEDs are out")
    finally:
        if simulation is not None:
            simulation.close()


def _hold(opened: LightController, number: int | None, level: int) -> NoReturn:
    """Light LED `number`, or with None each LED in turn, until somebody interrupts."""
    from rig.signals import signals_held_back

    leds = range(opened.led_count) if number is None else (number,)
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
