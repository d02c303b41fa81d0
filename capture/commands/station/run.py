"""``ps4rig station run``."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from capture.commands import options
from capture.console import reported


@reported
def run(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the station.")],
    rig: Annotated[
        str | None,
        typer.Option(
            help="'sim' for the simulated rig, or a rig.toml.",
            show_default="that of station.toml",
            metavar="RIG",
        ),
    ] = None,
    parts: Annotated[
        int | None,
        typer.Option(min=1, help="End after so many parts.", show_default="no end", metavar="N"),
    ] = None,
    trigger: Annotated[
        Literal["timer", "enter", "sensor"] | None,
        typer.Option(help="Where triggers come from.", show_default="that of station.toml"),
    ] = None,
    operator: options.Operator = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print each event as one line of JSON.")
    ] = False,
) -> None:
    """Inspect part after part. Ctrl-C ends it after the part in progress.

    With --trigger enter each line is a trigger, its text the id of the part; q ends it. The exit
    status is 1 if a part did not pass.
    """
    from functools import partial

    from capture.station.control_chart import ControlChart
    from capture.station.event_lines import log_to
    from capture.station.events import Publisher
    from capture.station.folder import station_folder
    from capture.station.run import RunOptions, run_station
    from capture.station.triggers import LineTrigger, SensorTrigger, TimerTrigger, TriggerSource
    from rig.config.rig import config_of

    from .terminal import print_event, print_event_as_json, read_key_line

    with station_folder(folder) as opened:
        config = opened.config
        rig_config = config_of(rig or config.rig_in(folder))
        sources: dict[str, TriggerSource] = {
            "enter": LineTrigger(read_key_line),
            "timer": TimerTrigger(config.timer_s),
            "sensor": SensorTrigger(),
        }
        source = sources[trigger or config.trigger]
        shown, log = print_event_as_json if json else print_event, partial(log_to, opened)
        names = [f"LED {tilt_deg:g}" for tilt_deg in rig_config.lights.tilts_deg]
        with Publisher(shown, log, ControlChart(names, shown, log)) as publisher:
            stopped = run_station(
                opened, rig_config, source, publisher, RunOptions(operator, parts)
            )
    if stopped.rejected:
        raise typer.Exit(1)
