"""`panel_process`: the panel beside a run, in a process that is started again when it ends."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from capture.base.process_settings import yield_processors
from capture.batch.local_pool import terminal_signals_blocked
from capture.station.domain.folder import StationFolder
from capture.station.domain.interface_config import PanelConfig

# Pause before another start: short after a panel that has served for long.
_FIRST_PAUSE_S, _LONGEST_PAUSE_S, _LONG_S = 0.1, 10.0, 5.0
# For its last answers; then it is killed.
_END_S = 8.0


@contextmanager
def panel_process(
    folder: Path, settings: PanelConfig, listener: socket.socket, warn: Callable[[str], None]
) -> Iterator[None]:
    """Run the panel of a station in a process of its own while the block runs.

    The socket stays open between two processes: a browser waits instead of being refused.
    """
    panel = PanelProcess(folder, settings, listener, warn)
    thread = threading.Thread(target=panel.keep_running, name="panel process")
    thread.start()
    try:
        yield
    finally:
        panel.end(thread)
        listener.close()


class PanelProcess:
    """Starts the panel, and starts it again whenever it ends."""

    def __init__(
        self,
        folder: Path,
        settings: PanelConfig,
        listener: socket.socket,
        warn: Callable[[str], None],
    ) -> None:
        self._panel, self._warn = (folder, settings, listener), warn
        self._ending = threading.Event()
        self._process: ForkServerProcess | None = None
        # Forks processes that have the modules already: to load them takes seconds.
        self._context = get_context("forkserver")
        self._context.set_forkserver_preload([serve_panel.__module__, f"{__package__}.server"])
        self._far_end, self._lifeline = self._context.Pipe(duplex=False)

    def keep_running(self) -> None:
        """Run the panel until `end`."""
        pause_s = _FIRST_PAUSE_S
        while not self._ending.is_set():
            began_s, status = time.monotonic(), self._run()
            if self._ending.is_set():
                return
            if time.monotonic() - began_s > _LONG_S:
                pause_s = _FIRST_PAUSE_S
            self._warn(f"the panel ended ({status}) and is started again")
            self._ending.wait(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)

    def _run(self) -> str:
        self._process = self._context.Process(
            target=serve_panel, args=(*self._panel, self._far_end), name="panel", daemon=True
        )
        try:
            with terminal_signals_blocked():
                self._process.start()
        except OSError as error:
            return str(error)
        self._process.join()
        return f"status {self._process.exitcode}"

    def end(self, thread: threading.Thread) -> None:
        """Let the panel end, and the thread that keeps it running."""
        self._ending.set()
        self._lifeline.close()
        thread.join(_END_S)
        if thread.is_alive() and self._process is not None:
            self._process.kill()
        thread.join()
        self._far_end.close()


def serve_panel(
    folder: Path, settings: PanelConfig, listener: socket.socket, lifeline: Connection
) -> None:
    """Serve the panel of a station until the other end of `lifeline` is closed."""
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
    panel = Panel.of(station, StationLink(station), settings)
    with serving_panel(panel, listener, is_over.set):
        is_over.wait()
