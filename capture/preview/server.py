"""The preview's page on this machine's own address, and nowhere else."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from classify.errors import InputError

from .loop import Preview

__all__ = ["MAX_VIEWERS", "PreviewServer", "serving"]

ADDRESS = "127.0.0.1"
# Requests at a time; more are turned away.
MAX_VIEWERS = 32
_REQUEST_TIMEOUT_S = 5.0
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
    """Answers a few requests at a time, each in a thread of its own.

    Raises
    ------
    InputError
        If the port is not free.
    """

    daemon_threads = True
    request_queue_size = MAX_VIEWERS

    def __init__(self, preview: Preview, port: int) -> None:
        self.preview = preview
        self._free = threading.BoundedSemaphore(MAX_VIEWERS)
        try:
            super().__init__((ADDRESS, port), _Request)
        except OSError as error:
            raise InputError(
                f"port {port} cannot be used: {error.strerror}; give another with --port"
            ) from error

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{ADDRESS}:{self.server_port}/"

    @property
    def hosts(self) -> tuple[str, ...]:
        """What a browser that means us puts into Host."""
        return (f"{ADDRESS}:{self.server_port}", f"localhost:{self.server_port}")

    def process_request(
        self, request: socket.socket | tuple[bytes, socket.socket], client_address: Any
    ) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(
        self, request: socket.socket | tuple[bytes, socket.socket], client_address: Any
    ) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        # A viewer that went away in the middle of an answer is nobody's error.
        pass


class _Request(BaseHTTPRequestHandler):
    server: PreviewServer
    timeout = _REQUEST_TIMEOUT_S
    server_version = "ps4rig"
    sys_version = ""

    def do_GET(self) -> None:
        # Any site may make its own name point to this machine, and would then be let in by a
        # browser; what it cannot do is put our name there.
        if self.headers.get("Host") not in self.server.hosts:
            self._answer(421, "text/plain", b"this is not the address of the preview\n")
            return
        path = self.path.partition("?")[0]
        if path in _FILES:
            name, kind = _FILES[path]
            self._answer(200, kind, (_HERE / name).read_bytes())
        elif path == "/state.json":
            state = json.dumps(self.server.preview.state(), allow_nan=False)
            self._answer(200, "application/json", state.encode())
        else:
            picture = self._picture(path)
            if picture is None:
                self._answer(404, "text/plain", b"there is no such thing\n")
            else:
                self._answer(200, "image/png", picture)

    def _picture(self, path: str) -> bytes | None:
        light = path.removeprefix("/light/").removesuffix(".png")
        if path != f"/light/{light}.png" or not (light.isascii() and light.isdecimal()):
            return None
        return self.server.preview.picture(int(light[:4]))

    def _answer(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        # One line for every picture would bury what there is to say.
        pass


@contextmanager
def serving(preview: Preview, port: int) -> Iterator[PreviewServer]:
    """Serve the page from a thread, while the block runs."""
    server = PreviewServer(preview, port)
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
