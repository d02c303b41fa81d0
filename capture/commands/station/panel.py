"""``ps4rig station panel``."""

from __future__ import annotations

import threading

from capture.base.console import complain, reports_errors

from .run import Host, Port
from .teach import Station


@reports_errors
def panel(folder: Station, host: Host = None, port: Port = None) -> None:
    """Serve the panel of a station until Ctrl-C, beside a run with --no-panel.

    It shows results and recipes without a run, too, and follows each run that begins.
    """
    from capture.base.process_settings import yield_processors

    yield_processors()
    from capture.station.domain.folder import StationFolder
    from capture.station.panel.panel import Panel
    from capture.station.panel.server import serving_panel
    from capture.station.panel.station_link import StationLink

    from .interfaces import panel_settings

    station, is_over = StationFolder(folder), threading.Event()
    settings = panel_settings(station.config.panel, host, port)
    with serving_panel(
        Panel(station, StationLink(station), settings), ended=is_over.set
    ) as address:
        complain(f"panel: {address}")
        is_over.wait()
