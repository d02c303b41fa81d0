"""Serving a simulated controller: a background thread between its endpoint and its bytes."""

import os
import select
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from .clock import Clock, VirtualClock
from .endpoints import Endpoint, PtyEndpoint, TtyEndpoint, tcp_endpoint, unix_endpoint

__all__ = ["Device", "Server", "serve_pty", "serve_tcp", "serve_tty", "serve_unix"]

_TURN_MS = 5  # the longest time between two polls of the device
_READ_BYTES = 256  # few lines at a time, so that stop() need not wait for many link delays


class Device(Protocol):
    """What is served: a `SimulatedController`, or one behind a damaged line."""

    @property
    def clock(self) -> Clock:
        """Its time, real or virtual."""

    @property
    def boot_remaining_s(self) -> float:
        """Time until it is ready; 0 when it is."""

    def connect(self) -> None:
        """A host has opened the port."""

    def reset(self) -> None:
        """Power cycle."""

    def feed(self, data: bytes) -> None:
        """Bytes from the host; returns when every line in them has been executed."""

    def poll(self) -> None:
        """One turn of its main loop. Never waits."""

    def take_output(self) -> bytes:
        """What it has sent since the last call."""


def serve_pty(controller: Device, link: str | Path | None = None) -> "Server":
    """Serve on a pseudo-terminal; `link` is a path for a symbolic link to it."""
    return Server(controller, PtyEndpoint(None if link is None else Path(link)))


def serve_tty(controller: Device, path: str | Path, baud: int = 115_200) -> "Server":
    """Serve on a serial device: this end of a null modem, or of a USB gadget's line."""
    return Server(controller, TtyEndpoint(Path(path), baud))


def serve_unix(controller: Device, path: str | Path) -> "Server":
    """Serve on a unix socket; the path must not exist yet."""
    return Server(controller, unix_endpoint(Path(path)))


def serve_tcp(controller: Device, port: int = 0) -> "Server":
    """Serve on a TCP port of 127.0.0.1; 0 takes a free one."""
    return Server(controller, tcp_endpoint(port))


class Server:
    """A controller being served, from construction until `stop` or the end of a `with` block.

    Parameters
    ----------
    controller
        The device. With a virtual clock it also runs once per simulated millisecond.
    endpoint
        Where it is served; closed by `stop`.
    """

    def __init__(self, controller: Device, endpoint: Endpoint) -> None:
        self._controller = controller
        self._endpoint = endpoint
        self._wake_read, self._wake_write = os.pipe()
        self._stopping = threading.Event()
        self._stop_lock = threading.Lock()
        self._unregister = _run_on_ticks(controller)
        self._thread = threading.Thread(target=self._run, name="simulated controller", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """What a host opens: a terminal's path, a socket's path or `socket://127.0.0.1:PORT`.

        Of a serial device it is this end's path; the host opens the other.
        """
        return self._endpoint.address

    def stop(self) -> None:
        """Unplug the device: LEDs out, the host sees the line go. May be called again."""
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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
        """Carry bytes both ways until the host hangs up or the server stops."""
        unsent = b""
        while not self._stopping.is_set():
            self._boot_in_virtual_time()
            self._controller.poll()
            # taken only when the last is gone: what a host does not read stays in the device,
            # whose buffer is bounded
            unsent = unsent or self._controller.take_output()
            try:
                unsent = _write(host_fd, unsent)
                events = self._wait(host_fd, select.POLLOUT if unsent else 0)
                if events.get(host_fd, 0) & ~select.POLLOUT:
                    # a hang-up shows here too, after the bytes that came before it
                    data = os.read(host_fd, _READ_BYTES)
                    if not data:
                        return
                    self._controller.feed(data)
                elif self._endpoint.listener_fd in events:
                    self._endpoint.refuse()
            except OSError:
                return  # the host has gone

    def _wait(self, host_fd: int | None = None, host_events: int = 0) -> dict[int, int]:
        """Wait for bytes, a host or `stop`, for one turn at most; return events by descriptor."""
        poll = select.poll()
        poll.register(self._wake_read, select.POLLIN)
        if self._endpoint.listener_fd is not None:
            poll.register(self._endpoint.listener_fd, select.POLLIN)
        if host_fd is not None:
            poll.register(host_fd, select.POLLIN | host_events)
        return dict(poll.poll(_TURN_MS))

    def _boot_in_virtual_time(self) -> None:
        # a host may be waiting for the banner: nobody else spends the time that booting takes
        clock = self._controller.clock
        if isinstance(clock, VirtualClock):
            clock.sleep_s(self._controller.boot_remaining_s)


def _run_on_ticks(controller: Device) -> Callable[[], None]:
    if isinstance(controller.clock, VirtualClock):
        return controller.clock.on_tick(controller.poll)
    return lambda: None


def _write(fd: int, data: bytes) -> bytes:
    """Write what fits; return the rest."""
    if not data:
        return data
    try:
        return data[os.write(fd, data) :]
    except BlockingIOError:
        return data
