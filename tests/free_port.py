"""A port for a server that a test starts in another process."""

import itertools
import os
import socket

# Below those that Linux gives to connections, and to servers that take any: 32768 and more.
_FIRST, _PROCESSES, _OF_EACH = 20_000, 1_000, 12


def free_port() -> int:
    """Return a port of 127.0.0.1 that nobody else takes until the server listens there."""
    for port in itertools.count(_FIRST + os.getpid() % _PROCESSES * _OF_EACH):
        try:
            socket.create_server(("127.0.0.1", port)).close()
        except OSError:
            continue
        return port
    raise AssertionError
