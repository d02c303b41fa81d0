"""Serve a simulated controller: a background thread between an endpoint and the device."""

import os
import select
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Self

from .clock import VirtualClock
from .controller import SimulatedController
from .endpoints import Endpoint, PtyEndpoint, TtyEndpoint, tcp_endpoint, unix_endpoint

_POLL_MS = 5  # longest time between two polls; the watchdog is late by this at most
_READ_BYTES = 256  # few lines at a time, so that stop() does not wait for many link delays


def serve_pty(controller: SimulatedController, link: str | Path | None = None) -> "Server":
    """Serve on a pseudo-terminal; `link` is a path for a symbolic link to it."""
    return Server(controller, PtyEndpoint(None if link is None else Path(link)))


def serve_tty(controller: SimulatedController, path: str | Path, baud: int = 115_200) -> "Server":
    """Serve on a serial device: this end of a null modem, or of a USB gadget's line."""
    return Server(controller, TtyEndpoint(Path(path), baud))


def serve_unix(controller: SimulatedController, path: str | Path) -> "Server":
    """Serve on a unix socket; the path must not exist yet."""
    return Server(controller, unix_endpoint(Path(path)))


def serve_tcp(controller: SimulatedController, port: int = 0) -> "Server":
    """Serve on a TCP port of 127.0.0.1; 0 chooses a free one."""
    return Server(controller, tcp_endpoint(port))


class Server:
    """Serves a controller from construction until `stop` or the end of a `with` block.

    On a virtual clock the controller also runs once per simulated millisecond.
    """

    def __init__(self, controller: SimulatedController, endpoint: Endpoint) -> None:
        self._controller = controller
        self._endpoint = endpoint
        self._wake_read, self._wake_write = os.pipe()
        self._stopping = threading.Event()
        self._stop_lock = threading.Lock()
        self._unregister: Callable[[], None] = lambda: None
        if isinstance(controller.clock, VirtualClock):
            self._unregister = controller.clock.on_tick(controller.poll)
        self._thread = threading.Thread(target=self._run, name="simulated controller", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """The address for hosts: path of a terminal or socket, or ``socket://127.0.0.1:PORT``.

        With a serial device it is the path of this end; the host opens the other.
        """
        return self._endpoint.address

    def stop(self) -> None:
        """Unplug the device: LEDs off, the host's line closed. May be called again."""
        with self._stop_lock:
            if self._stopping.is_set():
                return
            self._stopping.set()
            os.write(self._wake_write, b"\0")
            self._thread.join()
            self._unregister()
            self._endpoint.close()
            os.close(self._wake_read)
            os.close(self._wake_write)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._boot_in_virtual_time()
                host_fd = self._endpoint.accept()
                if host_fd is None:
                    self._wait()
                    self._controller.poll()
                else:
                    self._controller.connect()
                    self._converse(host_fd)
                    self._endpoint.hang_up()
        finally:
            self._controller.reset()

    def _converse(self, host_fd: int) -> None:
        """Pass bytes both ways until the host hangs up or the server stops."""
        unsent = b""
        while not self._stopping.is_set():
            self._boot_in_virtual_time()
            self._controller.poll()
            # Replies that a host does not read stay in the device, whose buffer is bounded.
            unsent = unsent or self._controller.take_output()
            try:
                unsent = _write(host_fd, unsent)
                events = self._wait(host_fd, select.POLLOUT if unsent else 0)
                if events.get(host_fd, 0) & ~select.POLLOUT:
                    # A hang-up is an empty read, after the bytes that came before it.
                    data = os.read(host_fd, _READ_BYTES)
                    if not data:
                        return
                    self._controller.feed(data)
                elif self._endpoint.listener_fd in events:
                    self._endpoint.refuse()
            except OSError:
                return  # the host has gone

    def _wait(self, host_fd: int | None = None, host_events: int = 0) -> dict[int, int]:
        """Wait for bytes, a host or `stop` until the next poll; return events by descriptor."""
        poll = select.poll()
        poll.register(self._wake_read, select.POLLIN)
        if self._endpoint.listener_fd is not None:
            poll.register(self._endpoint.listener_fd, select.POLLIN)
        if host_fd is not None:
            poll.register(host_fd, select.POLLIN | host_events)
        return dict(poll.poll(_POLL_MS))

    def _boot_in_virtual_time(self) -> None:
        # A host that waits for the banner does not advance the clock.
        clock = self._controller.clock
        if isinstance(clock, VirtualClock):
            clock.sleep_s(self._controller.boot_remaining_s)


def _write(fd: int, data: bytes) -> bytes:
    """Write as much as possible; return the rest."""
    if not data:
        return data
    try:
        return data[os.write(fd, data) :]
    except BlockingIOError:
        return data
