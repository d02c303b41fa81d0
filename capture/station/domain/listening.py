"""Sockets on which the station listens."""

import socket

from .errors import CannotListen


def listening_socket(
    section: str,
    host: str,
    port: int,
    *,
    advice: str,
    most_unacknowledged_ms: int,
    send_buffer_bytes: int | None = None,
) -> socket.socket:
    """Listen on a port that no other program has; 0 chooses a free one.

    All options are set before it listens, because a connection inherits those of the listener.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # not on Windows
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, most_unacknowledged_ms)
        if send_buffer_bytes is not None:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, send_buffer_bytes)
        listener.bind((host, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise CannotListen(f"[{section}] {host}:{port}: {error.strerror}; {advice}") from error
    return listener
