"""``ps4rig rig lights``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.console import out, reported

if TYPE_CHECKING:
    from rig import LightController

__all__ = ["lights"]

# How often it is made sure that the LED is still on, and how long each is on in turn.
_LOOK_S = 1.0


@reported
def lights(
    led: Annotated[
        str, typer.Argument(metavar="LED", help="Its number, from 0, or cycle, or off.")
    ],
    level: Annotated[
        int, typer.Option(min=0, max=100, help="Brightness in percent.", metavar="PERCENT")
    ] = 100,
    rig: Annotated[
        Path, typer.Option(help="The rig's configuration, or sim.", metavar="RIG")
    ] = Path("rig.toml"),
) -> None:
    """Switch an LED by hand; it is on until Ctrl-C, or all in turn with cycle.

    The camera is left alone. The LEDs are out at the end, whatever ends it.
    """
    from rig import ConfigError, RigConfig, load_config
    from rig.rig import open_lights
    from rig.simulation.rig import Simulation

    if led not in ("cycle", "off") and not led.isdecimal():
        raise ConfigError(f"LED {led!r} is neither a number nor cycle nor off")
    config = RigConfig() if str(rig) == "sim" else load_config(rig)
    if config.is_simulated:
        # Somebody is watching: here time must pass.
        config = config.with_changes(simulation={"clock": "real"})
    simulation = Simulation(config) if config.is_simulated else None
    try:
        with open_lights(config, simulation) as opened:
            if led == "off":
                opened.off()
                out.print(f"all LEDs of {opened.identity.serial_number} are out")
                return
            number = None if led == "cycle" else int(led)
            if number is not None and number >= opened.led_count:
                raise ConfigError(
                    f"LED {led}: the controller has {opened.led_count}, counted from 0"
                )
            _hold(opened, number, level)
    finally:
        if simulation is not None:
            simulation.close()


def _hold(opened: LightController, number: int | None, level: int) -> None:
    """Until somebody interrupts, which is the ordinary end."""
    leds = range(opened.led_count) if number is None else (number,)
    try:
        for led in leds:
            opened.set_level(led, level)
        while True:
            for led in leds:
                if opened.state().led != led:
                    opened.select(led)
                    out.print(f"LED {led} is on at {level} %; Ctrl-C puts it out")
                time.sleep(_LOOK_S)
                opened.confirm(led)
    except KeyboardInterrupt:
        out.print("all LEDs are out")
