"""Serve a simulated controller: a thread between an endpoint and the device."""

import selectors
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Self

from .clock import VirtualClock
from .controller import SimulatedController
from .endpoints import Endpoint, HostLine, tcp_endpoint, unix_endpoint

_POLL_S = 0.005  # longest time between two polls; the watchdog is late by this at most
_READ_BYTES = 256  # few lines at a time, so that stop() does not wait for many link delays
# Windows has no poll, and the selector for epoll takes five system calls for each wait.
_Selector = getattr(selectors, "PollSelector", selectors.SelectSelector)


def serve_local(controller: SimulatedController) -> "Server":
    """Serve on a pseudo-terminal, or where there is none on a TCP port of 127.0.0.1."""
    try:
        return serve_pty(controller)
    except (ImportError, OSError):  # OSError: all are taken, or /dev/pts is not mounted
        return serve_tcp(controller)


def serve_pty(controller: SimulatedController, link: str | Path | None = None) -> "Server":
    """Serve on a pseudo-terminal; `link` is a path for a symbolic link to it."""
    from .terminals import PtyEndpoint

    return Server(controller, PtyEndpoint(None if link is None else Path(link)))


def serve_tty(controller: SimulatedController, path: str | Path, baud: int = 115_200) -> "Server":
    """Serve on a serial device: this end of a null modem, or of a USB gadget's line."""
    from .terminals import TtyEndpoint

    return Server(controller, TtyEndpoint(Path(path), baud))


def serve_unix(controller: SimulatedController, path: str | Path) -> "Server":
    """Serve on a unix socket; the path must not exist yet."""
    return Server(controller, unix_endpoint(Path(path)))


def serve_tcp(controller: SimulatedController, port: int = 0) -> "Server":
    """Serve on a TCP port of 127.0.0.1; 0 chooses a free one."""
    return Server(controller, tcp_endpoint(port))


class Server:
    """A server of one controller, from construction until `stop` or the end of a `with`."""

    def __init__(self, controller: SimulatedController, endpoint: Endpoint) -> None:
        self._controller = controller
        self._endpoint = endpoint
        self._stopping = threading.Event()
        self._stop_lock = threading.Lock()
        self._unregister: Callable[[], None] = lambda: None
        if isinstance(controller.clock, VirtualClock):
            self._unregister = controller.clock.on_tick(controller.poll)
        self._thread = threading.Thread(target=self._run, name="simulated controller", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """The address for hosts; for a serial device, the path of this end."""
        return self._endpoint.address

    def stop(self) -> None:
        """Unplug the device: LEDs off, the host's line closed. May be called again."""
        with self._stop_lock:
            if self._stopping.is_set():
                return
            self._stopping.set()
            self._thread.join()
            self._unregister()
            self._endpoint.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._boot_in_virtual_time()
                host = self._endpoint.accept()
                if host is None:
                    self._wait()
                    self._controller.poll()
                else:
                    self._controller.connect()
                    self._converse(host)
                    self._endpoint.hang_up()
        finally:
            self._controller.reset()

    def _converse(self, host: HostLine) -> None:
        """Pass bytes both ways until the host hangs up or the server stops."""
        unsent = b""
        while not self._stopping.is_set():
            self._boot_in_virtual_time()
            self._controller.poll()
            # Replies that the host does not read stay in the device, whose buffer is limited.
            unsent = unsent or self._controller.take_output()
            try:
                unsent = _write(host, unsent)
                readable = self._wait(host, waits_to_write=bool(unsent))
                if host.fileno() in readable:
                    # A hang-up is an empty read, after the bytes that came before it.
                    data = host.read(_READ_BYTES)
                    if not data:
                        return
                    self._controller.feed(data)
                elif self._endpoint.listener_fd in readable:
                    self._endpoint.refuse()
            except OSError:
                return  # the host has gone

    def _wait(self, host: HostLine | None = None, *, waits_to_write: bool = False) -> set[int]:
        """Wait for bytes or a host until the next poll; return the readable descriptors."""
        with _Selector() as selector:
            if self._endpoint.listener_fd is not None:
                selector.register(self._endpoint.listener_fd, selectors.EVENT_READ)
            if host is not None:
                events = selectors.EVENT_READ | (selectors.EVENT_WRITE if waits_to_write else 0)
                selector.register(host, events)
            if not selector.get_map():  # on Windows, `select` would return at once
                self._stopping.wait(_POLL_S)
                return set()
            ready = selector.select(_POLL_S)
        return {key.fd for key, events in ready if events & selectors.EVENT_READ}

    def _boot_in_virtual_time(self) -> None:
        # A host that waits for the banner does not advance the clock.
        clock = self._controller.clock
        if isinstance(clock, VirtualClock):
            clock.sleep_s(self._controller.boot_remaining_s)


def _write(host: HostLine, data: bytes) -> bytes:
    """Write as much as possible; return the rest."""
    if not data:
        return data
    try:
        return data[host.write(data) :]
    except BlockingIOError:
        return data
