"""``ps4rig station run`` and ``ps4rig station panel``."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from capture.base.console import complain
from capture.commands import options

if TYPE_CHECKING:
    from capture.station.run.live_view import LiveEvent


_Rig = Annotated[
    str | None,
    typer.Option(
        "--rig",
        help="'sim' for the simulated rig, or a rig.toml.",
        show_default="that of station.toml",
        metavar="RIG",
    ),
]
_Parts = Annotated[
    int | None,
    typer.Option(min=1, help="End after N parts.", show_default="no end", metavar="N"),
]
_Trigger = Annotated[
    Literal["timer", "enter", "sensor", "http", "modbus"] | None,
    typer.Option(help="Where triggers come from.", show_default="that of station.toml"),
]
_ServePanel = Annotated[
    bool | None,
    typer.Option("--panel/--no-panel", help="Serve the panel.", show_default="if its port is free"),
]
_Host = Annotated[
    str | None, typer.Option(help="Address of the panel.", show_default="that of station.toml")
]
_Port = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=65535,
        help="Port of the panel; 0 chooses a free one.",
        show_default="that of station.toml",
    ),
]
_Collect = Annotated[
    bool, typer.Option("--collect", help="Judge no part: capture parts that are to be taught.")
]
_Events = Annotated[bool, typer.Option("--json", help="Print each event as one line of JSON.")]


def run(
    folder: options.Station,
    rig: _Rig = None,
    parts: _Parts = None,
    trigger: _Trigger = None,
    panel: _ServePanel = None,
    host: _Host = None,
    port: _Port = None,
    collect: _Collect = False,
    operator: options.Operator = None,
    json: _Events = False,
) -> None:
    """Inspect part after part. Ctrl-C ends it after the part in progress.

    With --trigger enter each line is a trigger, its text the id of the part; q ends it. The exit
    status is 1 if a part did not pass. The panel, whose address is printed, triggers parts, too.

    With --collect each part is UNKNOWN, and neither recipe nor challenge set is needed; the exit
    status is 1 if a part is ERROR. Teach its parts in the panel, or by station teach.
    """
    import os

    from capture.base.process_settings import configure_station_process
    from capture.station.domain.folder import station_folder
    from capture.station.domain.verdict import Decision
    from capture.station.run.control_chart import ControlChart
    from capture.station.run.events import text_lines
    from capture.station.run.live_station import LiveStation
    from capture.station.run.run import run_station
    from capture.station.service.systemd import Notifier
    from rig.config.lights import led_names
    from rig.config.rig import config_of

    from .station_interfaces import running_interfaces, terminal_subscriber, trigger_source

    with station_folder(folder) as opened:
        config = opened.config
        rig_config = config_of(rig or opened.rig)
        trigger = trigger or config.trigger
        live = LiveStation(config.name, simulated=rig_config.is_simulated, trigger=trigger)
        terminal = terminal_subscriber(config.name, as_json=json)

        def log(live_event: LiveEvent) -> None:
            for line in text_lines(live_event.event):
                opened.log(line)

        notifier = Notifier.from_environment(os.environ)
        chart = ControlChart(led_names(rig_config.lights.tilts_deg), live.publish)
        subscribers = (terminal, log, chart, notifier.tell)
        with running_interfaces(
            opened, live, trigger, subscribers, panel=panel, host=host, port=port
        ):
            configure_station_process()
            source = trigger_source(trigger, config.timer_s)
            stopped = run_station(
                opened, rig_config, source, live, operator=operator, parts=parts,
                report_alive=notifier.report_alive, is_collecting=collect,
            )  # fmt: skip
    failed_parts = stopped.parts.get(Decision.ERROR) if collect else stopped.rejected
    if failed_parts:
        raise typer.Exit(1)


def panel(folder: options.Station, host: _Host = None, port: _Port = None) -> None:
    """Serve the panel of a station until Ctrl-C, beside a run with --no-panel.

    It shows results and recipes without a run, too, and follows each run that begins.
    """
    from capture.base.process_settings import yield_processors

    yield_processors()
    from capture.station.domain.folder import StationFolder
    from capture.station.panel.panel import Panel
    from capture.station.panel.server import serving_panel
    from capture.station.panel.station_link import StationLink

    from .station_interfaces import panel_settings

    station = StationFolder(folder)
    settings = panel_settings(station.config.panel, host, port)
    is_over = threading.Event()
    with serving_panel(
        Panel(station, StationLink(station), settings), ended=is_over.set
    ) as address:
        complain(f"panel: {address}")
        is_over.wait()
