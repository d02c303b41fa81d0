"""`panel_process`: the panel beside a run, in a process that is started again when it ends."""

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from capture.base.process_settings import yield_processors
from capture.station.domain.errors import error_text
from capture.station.domain.folder import StationFolder
from capture.station.domain.interface_config import PanelConfig

# Pause before the panel is started again. It doubles, and is reset after a panel that served for
# `_LONG_RUN_S`.
_FIRST_PAUSE_S, _MAX_PAUSE_S, _LONG_RUN_S = 0.1, 10.0, 5.0
# Time for the last answers of a panel before it is killed.
_END_TIMEOUT_S = 8.0


@contextmanager
def panel_process(
    folder: Path, settings: PanelConfig, listener: socket.socket, warn: Callable[[str], None]
) -> Iterator[None]:
    """Run the panel in a process of its own.

    Its socket stays open while the process is started again, so that browsers wait.
    """
    # The fork server has the modules loaded, which takes seconds.
    context = get_context("forkserver")
    context.set_forkserver_preload([_serve_panel.__module__, f"{__package__}.server"])
    child_end, lifeline = context.Pipe(duplex=False)
    is_over = threading.Event()
    running: list[BaseProcess] = []  # the present process, or none

    def serve() -> str:
        process = context.Process(
            target=_serve_panel, args=(folder, settings, listener, child_end), daemon=True
        )
        try:
            process.start()
        except (OSError, EOFError) as error:  # from the fork server
            return error_text(error)
        running.append(process)
        process.join()
        running.clear()
        return f"status {process.exitcode}"

    def keep_serving() -> None:
        pause_s = _FIRST_PAUSE_S
        while not is_over.is_set():
            began_s, why = time.monotonic(), serve()
            if not is_over.is_set():
                warn(f"the panel ended ({why}) and is started again")
            if time.monotonic() - began_s > _LONG_RUN_S:
                pause_s = _FIRST_PAUSE_S
            is_over.wait(pause_s)
            pause_s = min(2.0 * pause_s, _MAX_PAUSE_S)

    thread = threading.Thread(target=keep_serving, name="panel process", daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        lifeline.close()
        # A process that is still starting is not in the list, and ends by itself. A run that fails
        # at once does not wait for it.
        for process in (*running,):
            process.join(_END_TIMEOUT_S)
            process.kill()
        listener.close()


def _serve_panel(
    folder: Path, settings: PanelConfig, listener: socket.socket, lifeline: Connection
) -> None:
    """Serve the panel of a station until the other end of `lifeline` is closed."""
    os.setpgrp()  # the run ends the panel, not Ctrl-C in a terminal
    yield_processors()
    from .panel import Panel
    from .server import serving_panel
    from .station_link import StationLink

    station, is_over = StationFolder(folder), threading.Event()

    def await_end() -> None:
        with suppress(EOFError, OSError):
            lifeline.recv_bytes()
        is_over.set()

    threading.Thread(target=await_end, daemon=True).start()
    panel = Panel(station, StationLink(station), settings)
    with serving_panel(panel, listener, is_over.set):
        is_over.wait()
