"""``ps4rig station run``."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from capture.base.console import reported
from capture.commands import options


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
        typer.Option(min=1, help="End after N parts.", show_default="no end", metavar="N"),
    ] = None,
    trigger: Annotated[
        Literal["timer", "enter", "sensor", "http", "modbus"] | None,
        typer.Option(help="Where triggers come from.", show_default="that of station.toml"),
    ] = None,
    panel: Annotated[
        bool | None,
        typer.Option(
            "--panel/--no-panel", help="Serve the panel.", show_default="if its port is free"
        ),
    ] = None,
    host: Annotated[
        str | None,
        typer.Option(help="Address of the panel.", show_default="that of station.toml"),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help="Port of the panel; 0 chooses a free one.",
            show_default="that of station.toml",
        ),
    ] = None,
    collect: Annotated[
        bool,
        typer.Option("--collect", help="Judge no part: capture parts that are to be taught."),
    ] = False,
    operator: options.Operator = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print each event as one line of JSON.")
    ] = False,
) -> None:
    """Inspect part after part. Ctrl-C ends it after the part in progress.

    With --trigger enter each line is a trigger, its text the id of the part; q ends it. The exit
    status is 1 if a part did not pass. The panel, whose address is printed, triggers parts, too.

    With --collect each part is UNKNOWN, and neither recipe nor challenge set is needed. Teach its
    parts in the panel, or by station teach.
    """
    import os
    from contextlib import ExitStack
    from functools import partial

    from capture.base.process_settings import settle_station
    from capture.station.domain.folder import station_folder
    from capture.station.results.database import database_url
    from capture.station.results.database import shown as shown_url
    from capture.station.run.control_chart import ControlChart
    from capture.station.run.event_lines import log_to
    from capture.station.run.events import Publisher
    from capture.station.run.live_station import LiveStation
    from capture.station.run.run import RunOptions, run_station
    from capture.station.run.triggers import LineTrigger, SensorTrigger, TimerTrigger, TriggerSource
    from capture.station.service.notify import Notifier
    from classify.base.errors import InputError
    from rig.config.rig import config_of

    from .interfaces import modbus_of, mqtt_of, panel_of, panel_settings, plc_line
    from .terminal import read_key_line, shown_by

    with station_folder(folder) as opened:
        config = opened.config
        rig_config = config_of(rig or config.rig_in(folder))
        given = trigger or config.trigger
        sources: dict[str, TriggerSource | None] = {
            "enter": LineTrigger(read_key_line),
            "timer": TimerTrigger(config.timer_s),
            "sensor": SensorTrigger(),
            "http": None,
            "modbus": None,
        }
        source = sources[given]
        live = LiveStation(
            config.name,
            simulated=rig_config.is_simulated,
            trigger=given,
            database=shown_url(database_url(config.results_in(folder))),
        )
        shown, log = shown_by(config.name, as_json=json), partial(log_to, opened)
        names = [f"LED {tilt_deg:g}" for tilt_deg in rig_config.lights.tilts_deg]
        notifier = Notifier.from_environment(os.environ)
        chart = ControlChart(names, shown, log, live.tell)
        with ExitStack() as interfaces:
            if panel is False and given == "http":
                raise InputError("--no-panel: triggers come from the panel; give --trigger timer")
            if panel is not False:
                settings = panel_settings(config.panel, host, port)
                is_asked = bool(panel or host or port or given == "http")
                interfaces.enter_context(panel_of(opened, live, settings, is_asked=is_asked))
            line = plc_line(config, live, given)
            told = [] if line is None else [line.tell]
            if config.mqtt is not None:
                told.append(interfaces.enter_context(mqtt_of(config.mqtt, opened)).tell)
            publisher = interfaces.enter_context(
                Publisher(shown, log, chart, live.tell, notifier.tell, *told)
            )
            if line is not None:
                interfaces.enter_context(modbus_of(line, config.modbus))
            settle_station()
            stopped = run_station(
                opened,
                rig_config,
                live.attached(source),
                publisher,
                RunOptions(operator, parts, notifier.report_alive, is_collecting=collect),
            )
    if stopped.rejected:
        raise typer.Exit(1)
