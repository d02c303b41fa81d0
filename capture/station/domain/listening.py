"""`listening_socket`: a port of a station, for the panel or a PLC."""

import socket

from .errors import CannotListen


def listening_socket(
    section: str,
    host: str,
    port: int,
    *,
    advice: str,
    max_unacknowledged_ms: int,
    send_buffer_bytes: int | None = None,
) -> socket.socket:
    """Listen on a port (0: a free one) that no other program uses.

    All options are set before it listens, because connections inherit them.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # not on Windows
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, max_unacknowledged_ms)
        if send_buffer_bytes is not None:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, send_buffer_bytes)
        # A peer that vanished without closing is noticed after 10 + 3 * 5 s.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (("TCP_KEEPIDLE", 10), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 3)):
            if hasattr(socket, option):
                listener.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        listener.bind((host, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise CannotListen(f"[{section}] {host}:{port}: {error.strerror}; {advice}") from error
    return listener
