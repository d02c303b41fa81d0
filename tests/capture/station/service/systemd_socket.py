"""The socket on which systemd listens to a service."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

_TIMEOUT_S = 60.0


class SystemdSocket:
    """Receives datagrams as systemd does; `said` holds the lines of all of them."""

    def __init__(self, listening: socket.socket, address: str) -> None:
        self._listening = listening
        self.address = address
        self.said: list[list[str]] = []

    def receive(self, timeout_s: float) -> None:
        """Wait for a datagram, and take all that are there."""
        self._listening.settimeout(timeout_s)
        try:
            while True:
                self.said.append(self._listening.recv(4096).decode().split("\n"))
                self._listening.settimeout(0.0)
        except (TimeoutError, BlockingIOError):
            pass

    def until(self, is_there: Callable[[], bool]) -> None:
        """Receive until something holds."""
        ends_s = time.monotonic() + _TIMEOUT_S
        while not is_there():
            assert time.monotonic() < ends_s, self.said
            self.receive(0.2)

    def until_said(self, line: str) -> None:
        """Receive until a line begins so."""
        self.until(lambda: any(each.startswith(line) for lines in self.said for each in lines))

    def pings(self) -> int:
        """Number of pings of the watchdog."""
        return sum("WATCHDOG=1" in lines for lines in self.said)


@contextmanager
def systemd_socket(folder: Path, *, is_abstract: bool = False) -> Iterator[SystemdSocket]:
    """Listen on a socket in `folder`, or on one that has only a name."""
    name = str(folder / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(f"\0{name}" if is_abstract else name)
        yield SystemdSocket(listening, f"@{name}" if is_abstract else name)
