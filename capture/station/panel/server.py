"""`serving_panel`: the panel's web server, in a thread of the run."""

import asyncio
import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from capture.station.domain.interface_config import PanelConfig, listening_socket
from classify.base.errors import InputError

from .app import panel_app
from .panel import Panel

# A page opens up to six connections; forty browsers may look at once.
MAX_CONNECTIONS = 256
# The head of a request takes one packet. What is slower holds a connection that others need.
HEAD_S = 10.0
# A client that takes less than 48 kB in this time, the part of uvicorn's buffer that must be sent
# before it is filled again, does not read.
SEND_S = 30.0
_MAX_HEAD_BYTES = 16 * 1024
_KEEP_ALIVE_S = 15
_STOP_S = 5
_START_POLL_S = 0.01


class _Protocol(H11Protocol):
    """HTTP/1.1 with a limit of connections, and deadlines for heads and for slow readers."""

    _request: asyncio.TimerHandle | None = None
    _drain: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            transport.abort()
            return
        self._expect_request()

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in (self._request, self._drain):
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
        self._drain = self.loop.call_later(SEND_S, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._drain is not None:
            self._drain.cancel()

    def _expect_request(self) -> None:
        """Close the connection unless the head of another request is complete in time."""
        before = self.cycle

        def close_if_late() -> None:
            if self.cycle is before:
                self.transport.abort()

        if self._request is not None:
            self._request.cancel()
        self._request = self.loop.call_later(HEAD_S, close_if_late)


@contextmanager
def serving_panel(panel: Panel) -> Iterator[str]:
    """Serve a panel while the block runs; yield its address."""
    settings = panel.settings
    require_safe(panel)
    tls = _tls(panel)
    listener = listening_socket(
        "panel",
        settings.host,
        settings.port,
        advice="give another port with --port, or --no-panel",
        # What a vanished browser has not acknowledged can be too little for `_Protocol` to see.
        most_unacknowledged_ms=round(1000 * SEND_S),
    )
    config = uvicorn.Config(
        panel_app(panel),
        http=_Protocol,
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        date_header=True,
        # A proxy on this machine may say for whom it asks, nobody else.
        proxy_headers=settings.behind_proxy,
        forwarded_allow_ips=["127.0.0.1", "::1"],
        h11_max_incomplete_event_size=_MAX_HEAD_BYTES,
        timeout_keep_alive=_KEEP_ALIVE_S,
        timeout_graceful_shutdown=_STOP_S,
    )
    config.load()
    config.ssl = tls
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, args=([listener],), name="panel", daemon=True)
    thread.start()
    while thread.is_alive() and not server.started:
        thread.join(_START_POLL_S)
    if not server.started:
        raise InputError("the panel's web server did not start; see the error above")
    try:
        yield _address(settings, listener)
    finally:
        panel.live.close()
        server.should_exit = True
        thread.join()
        panel.jobs.close()
        panel.pictures.close()
        panel.results.close()


def require_safe(panel: Panel) -> None:
    """Check that a panel that other machines reach has users, and HTTPS."""
    settings, folder = panel.settings, panel.folder.path
    if settings.is_for_this_machine:
        return
    if not settings.is_https:
        raise InputError(
            f"[panel] host = {settings.host}: other machines would send passwords in the clear; "
            'give tls_cert and tls_key, or behind_proxy = true, or host = "127.0.0.1"'
        )
    if not panel.users.all():
        raise InputError(
            f"{folder}: a panel for other machines needs users; "
            f"run ps4rig station user add {folder} NAME --role administrator"
        )


def _tls(panel: Panel) -> ssl.SSLContext | None:
    files = panel.settings.tls_files(panel.folder.path)
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


def _no_password() -> str:
    """Refuse a key with a password: OpenSSL would ask for it on the terminal."""
    raise ValueError("the key has a password; give one without")


def _address(settings: PanelConfig, listener: socket.socket) -> str:
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    scheme = "https" if settings.tls_cert else "http"
    return f"{scheme}://{host}:{listener.getsockname()[1]}/"
