"""The web server of the preview, on 127.0.0.1 only."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from classify.errors import InputError

from .loop import Preview

__all__ = ["MAX_REQUESTS", "PreviewServer", "serving"]

ADDRESS = "127.0.0.1"
# Requests at a time, each with a thread; a page makes up to six. More are turned away.
MAX_REQUESTS = 32
# A page on this machine asks and is answered within milliseconds.
_DEADLINE_S = 5.0
_HERE = Path(__file__).parent
_FILES = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; img-src 'self'; script-src 'self'; connect-src 'self'; "
        "style-src 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class PreviewServer(ThreadingHTTPServer):
    """Answers up to `MAX_REQUESTS` requests at a time, each in a thread of its own.

    Parameters
    ----------
    port
        0 takes any that is free.
    deadline_s
        A request that is not finished by then is cut off, however its client spends the time.

    Raises
    ------
    InputError
        If the port is not free.
    """

    daemon_threads = True
    request_queue_size = MAX_REQUESTS

    def __init__(self, preview: Preview, port: int, deadline_s: float = _DEADLINE_S) -> None:
        self.preview = preview
        self._deadline_s = deadline_s
        self._open: dict[socket.socket, float] = {}
        try:
            super().__init__((ADDRESS, port), _Request)
        except OSError as error:
            raise InputError(
                f"port {port} cannot be used: {error.strerror}; give another with --port"
            ) from error

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{ADDRESS}:{self.server_port}/"

    @property
    def hosts(self) -> tuple[str, ...]:
        """Values of the Host header that are answered."""
        return (f"{ADDRESS}:{self.server_port}", f"localhost:{self.server_port}")

    def process_request(self, request: Any, client_address: Any) -> None:
        if len(self._open) < MAX_REQUESTS:
            self._open[request] = time.monotonic() + self._deadline_s
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        super().shutdown_request(request)
        self._open.pop(request, None)

    def service_actions(self) -> None:
        # A time-out of the socket alone begins again with each byte of a slow client.
        now_s = time.monotonic()
        for request, deadline_s in list(self._open.items()):
            if now_s > deadline_s:
                with suppress(OSError):  # it has just been closed
                    request.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        # A viewer that leaves in the middle of an answer is no error.
        pass


class _Request(BaseHTTPRequestHandler):
    server: PreviewServer
    server_version = "ps4rig"
    sys_version = ""

    def do_GET(self) -> None:
        # A site that points its own name at 127.0.0.1 (DNS rebinding) is refused by this header.
        if self.headers.get("Host") not in self.server.hosts:
            self._answer(421, "text/plain", b"not the address of the preview\n")
            return
        path = self.path.partition("?")[0]
        if path in _FILES:
            name, kind = _FILES[path]
            self._answer(200, kind, (_HERE / name).read_bytes())
        elif path == "/state.json":
            state = json.dumps(self.server.preview.state(), allow_nan=False)
            self._answer(200, "application/json", state.encode())
        elif (png := self._png(path)) is not None:
            self._answer(200, "image/png", png)
        else:
            self._answer(404, "text/plain", b"no such page\n")

    def _png(self, path: str) -> bytes | None:
        light = path.removeprefix("/light/").removesuffix(".png")
        if path != f"/light/{light}.png" or not (light.isascii() and light.isdecimal()):
            return None
        return self.server.preview.png(int(light[:4]))

    def _answer(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        # A line for every image would bury the messages of the command.
        pass


@contextmanager
def serving(
    preview: Preview, port: int, deadline_s: float = _DEADLINE_S
) -> Iterator[PreviewServer]:
    """Serve the page from a thread while the block runs; arguments as `PreviewServer`."""
    server = PreviewServer(preview, port, deadline_s)
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
