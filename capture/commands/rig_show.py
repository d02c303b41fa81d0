"""Commands that show a rig: rig doctor, rig lights, rig preview."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from capture.base.console import new_table, out, print_json, print_table
from capture.commands import options
from classify.base.errors import InputError
from rig.doctor.check import Check

if TYPE_CHECKING:
    from rig import LightController

_FAULT_STATUS = 1
_STYLES = {"ok": "green", "warning": "yellow", "fault": "bold red", "unknown": "dim"}


def print_checks(checks: Sequence[Check], *, as_json: bool) -> None:
    """Print checks as a table or as JSON, and exit with status 1 if one found a fault."""
    from rich.text import Text

    counts = {
        status: sum(check.status == status for check in checks)
        for status in ("fault", "warning", "unknown")
    }
    if as_json:
        print_json({"checks": [asdict(check) for check in checks], **counts})
    else:
        table = new_table("what", "status", "seen", prose="seen")
        for check in checks:
            finding = Text(check.seen)
            if check.advice:
                finding.append("\n-> " + check.advice, style="bold")
            table.add_row(check.name, Text(check.status, style=_STYLES[check.status]), finding)
        print_table(table)
        out.print(", ".join(f"{status}: {count}" for status, count in counts.items()))
    if counts["fault"]:
        raise typer.Exit(_FAULT_STATUS)


def doctor(
    rig: options.Rig = "rig.toml",
    has_sheet: Annotated[
        bool,
        typer.Option(
            "--sheet",
            help="A white matt sheet is below the camera: compare LEDs, lights, camera and lens "
            "with the calibration of the rig. A simulated rig does so anyway.",
        ),
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Check the whole rig; print each finding, and a remedy for each fault.

    It checks ports, permissions, controller, watchdog, camera, frames, and an image under each
    LED: put a surface with relief below the camera, or a white sheet with --sheet. The exit status
    is 1 if there is a fault.
    """
    from capture.procedures.rig_check import check_calibration
    from rig.doctor.diagnosis import diagnose

    more_checks = partial(check_calibration, has_sheet=has_sheet)
    print_checks(list(diagnose(rig, more_checks=more_checks)), as_json=as_json)


# Time between two checks that the LED is still on. With cycle, each LED is on for this time.
_CHECK_S = 1.0


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
    from rig import ConfigError, Simulation
    from rig.config.rig import config_of
    from rig.rig import open_lights

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
                _light_in_turn(opened, leds, level)
            except KeyboardInterrupt:  # Ctrl-C is the normal end
                opened.put_out()
                out.print("all LEDs are out")
    finally:
        if simulation is not None:
            simulation.close()


def _light_in_turn(opened: LightController, leds: Sequence[int], level: int) -> NoReturn:
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


def preview(
    rig: options.Rig = "rig.toml",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0 chooses a free one.")
    ] = options.PREVIEW_PORT,
    outline: Annotated[
        Path | None,
        typer.Option(
            metavar="SET",
            help="Draw the outline of the part in this set over the images, and state its "
            "orientation now.",
        ),
    ] = None,
    turn_to: Annotated[
        float | None,
        typer.Option(
            metavar="DEG", help="Orientation at which the outline is drawn; without it, as in SET."
        ),
    ] = None,
) -> None:
    """Show live images under each LED on a page of this machine, as the LEDs stand.

    Each image has a histogram, saturated pixels in red, a focus score and its age; an image that is
    too old is blanked. Errors of the rig are shown, and the rig is opened again. Ctrl-C ends the
    preview and switches the LEDs off.
    """
    import threading

    from capture.session.live_view import PlacementGuide
    from capture.session.preview_loop import Preview, run_preview, serving
    from rig.config.rig import config_of

    config = config_of(rig)
    preview, measure = Preview(), None
    if turn_to is not None and (outline is None or not -360.0 <= turn_to <= 360.0):
        raise InputError(
            f"--turn-to {turn_to:g}: give degrees from -360 to 360, with --outline SET"
        )
    if outline is not None:
        guide = PlacementGuide.of(outline, turn_to)
        preview.guide(f"turn to {guide.required_deg:g} degrees", guide.outline.svg())
        measure = partial(guide.orientation_text, config.lights.lighting)
    with serving(preview, port) as server:
        out.print(f"{server.url} shows the rig; Ctrl-C ends it")
        out.file.flush()
        run_preview(config, preview, threading.Event(), measure)
