"""The panel's port, with its address and certificate, and `serving_panel`: its web server."""

import asyncio
import logging
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.listening import listening_socket
from capture.station.domain.users import Users
from classify.base.errors import InputError

from .app import panel_app
from .panel import Panel

# Enough for forty browsers: a page opens up to six connections.
MAX_CONNECTIONS = 256
# Four addresses can take all connections. Connections of a proxy are not limited by their address.
MAX_CONNECTIONS_OF_AN_ADDRESS = 64
# Time for which a refused connection stays open, and number of such connections. Closed at once, a
# client that tries again at once would keep a processor busy.
REFUSED_S, _MAX_REFUSED = 2.0, 512
# Time for the head of a request to arrive, which takes one packet. A slower client would occupy a
# connection that others need.
HEAD_S = 10.0
_MAX_HEAD_BYTES = 16 * 1024
_KEEP_ALIVE_S = 15
STOP_S = 5
_START_POLL_S = 0.01
# A client that takes less than 48 kB in this time, the part of uvicorn's buffer that must be sent
# before it is filled again, does not read.
SEND_S = 30.0


def panel_listener(folder: Path, settings: PanelConfig) -> socket.socket:
    """Listen on the panel's port, if that is safe."""
    _require_safe(folder, settings)
    _tls_context(folder, settings)
    return listening_socket(
        "panel",
        settings.host,
        settings.port,
        advice="give another port with --port",
        # What a vanished browser has not acknowledged can be too little for the server to see.
        max_unacknowledged_ms=round(1000 * SEND_S),
    )


def _require_safe(folder: Path, settings: PanelConfig) -> None:
    """Check that a panel that other machines reach has users, and HTTPS."""
    if settings.is_for_this_machine:
        return
    if not settings.is_https:
        raise InputError(
            f"[panel] host = {settings.host}: other machines would send passwords in the clear; "
            'give tls_cert and tls_key, or behind_proxy = true, or host = "127.0.0.1"'
        )
    if not Users(folder).all():
        raise InputError(
            f"{folder}: a panel for other machines needs users; "
            f"run ps4rig station user add {folder} NAME --role administrator"
        )


def _tls_context(folder: Path, settings: PanelConfig) -> ssl.SSLContext | None:
    """Return the context of HTTPS, or None without TLS."""
    files = settings.tls_files(folder)
    if files is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(*files, password=_no_password)
    except (OSError, ValueError) as error:
        raise InputError(
            f"[panel] tls_cert = {files[0]}, tls_key = {files[1]}: cannot be used: {error}"
        ) from error
    return context


def panel_address(settings: PanelConfig, listener: socket.socket) -> str:
    """Return the address that browsers ask."""
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    scheme = "https" if settings.tls_cert else "http"
    return f"{scheme}://{host}:{listener.getsockname()[1]}/"


def _no_password() -> str:
    """Refuse a key with a password: OpenSSL would ask for it on the terminal."""
    raise ValueError("the key has a password; give one without")


class _Protocol(H11Protocol):
    """HTTP/1.1 with limits of connections, and deadlines for heads and for slow readers."""

    _request_timer: asyncio.TimerHandle | None = None
    _send_timer: asyncio.TimerHandle | None = None
    _is_refused = False

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        peers = [peer for peer in self.connections if isinstance(peer, _Protocol)]
        served = [peer for peer in peers if not peer._is_refused]
        if len(served) > MAX_CONNECTIONS or self._is_one_too_many(served):
            self._refuse(len(peers) - len(served))
            return
        self._expect_request()

    def _refuse(self, refused_before: int) -> None:
        """Close the connection after `REFUSED_S`, without reading from it."""
        if refused_before >= _MAX_REFUSED:
            self.transport.abort()
            return
        self._is_refused = True
        self.transport.pause_reading()
        self._request_timer = self.loop.call_later(REFUSED_S, self.transport.abort)

    def _is_one_too_many(self, served: list["_Protocol"]) -> bool:
        """Whether the address of this connection has too many connections."""
        if self.config.proxy_headers or self.client is None:
            return False
        clients = [peer.client for peer in served]
        return (
            sum(client is not None and client[0] == self.client[0] for client in clients)
            > MAX_CONNECTIONS_OF_AN_ADDRESS
        )

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in (self._request_timer, self._send_timer):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        before = self.cycle
        super().on_response_complete()
        if self.cycle is before:  # no further request has arrived already
            self._expect_request()

    def send_400_response(self, msg: str) -> None:
        """Refuse a malformed request, or cut it off if its answer has begun or has no body."""
        if self.cycle is not None:
            self.cycle.disconnected = True  # it sends nothing any more
            self.cycle.message_event.set()
        is_head = self.conn.our_state is h11.SEND_RESPONSE and self.scope["method"] == "HEAD"
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE) and not is_head:
            super().send_400_response(msg)
        else:
            self.transport.close()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._send_timer = self.loop.call_later(SEND_S, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._send_timer is not None:
            self._send_timer.cancel()

    def _expect_request(self) -> None:
        """Close the connection unless the head of a request is complete within `HEAD_S`."""
        before = self.cycle

        def close_if_late() -> None:
            if self.cycle is before:
                self.transport.abort()

        if self._request_timer is not None:
            self._request_timer.cancel()
        self._request_timer = self.loop.call_later(HEAD_S, close_if_late)


def _is_no_cancellation(record: logging.LogRecord) -> bool:
    """Whether a message is not the traceback of a request that the end of the panel cut off."""
    return not (record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError))


@contextmanager
def serving_panel(
    panel: Panel,
    listener: socket.socket | None = None,
    ended: Callable[[], None] = lambda: None,
) -> Iterator[str]:
    """Serve a panel while the block runs; yield its address."""
    # Without a `listener`, this opens the socket. `ended` is called in the server's thread when the
    # server has ended.
    settings = panel.settings
    tls = _tls_context(panel.folder.path, settings)
    listener = listener or panel_listener(panel.folder.path, settings)
    config = uvicorn.Config(
        panel_app(panel),
        http=_Protocol,
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        date_header=True,
        # Only a proxy on this machine may name the address of the client.
        proxy_headers=settings.behind_proxy,
        forwarded_allow_ips=["127.0.0.1", "::1"],
        h11_max_incomplete_event_size=_MAX_HEAD_BYTES,
        timeout_keep_alive=_KEEP_ALIVE_S,
        timeout_graceful_shutdown=STOP_S,
    )
    logging.getLogger("uvicorn.error").addFilter(_is_no_cancellation)
    config.load()
    config.ssl = tls
    server = uvicorn.Server(config)

    def serve() -> None:
        try:
            server.run([listener])
        finally:
            ended()

    thread = threading.Thread(target=serve, name="panel", daemon=True)
    thread.start()
    while thread.is_alive() and not server.started:
        thread.join(_START_POLL_S)
    if not server.started:
        raise InputError("the panel's web server did not start; see the error above")
    try:
        yield panel_address(settings, listener)
    finally:
        panel.live.close()
        server.should_exit = True
        thread.join()
        panel.jobs.close()
        panel.pictures.close()
        panel.results.close()
