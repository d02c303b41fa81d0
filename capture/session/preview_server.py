"""The web server of the preview, on 127.0.0.1 only."""

import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from classify.base.errors import InputError

from .preview_loop import Preview

_ADDRESS = "127.0.0.1"
_HERE = Path(__file__).parent
_FILES = {
    "/": ("preview.html", "text/html; charset=utf-8"),
    "/page.js": ("preview.js", "text/javascript; charset=utf-8"),
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


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, preview: Preview, port: int) -> None:
        self.preview = preview
        try:
            super().__init__((_ADDRESS, port), _Request)
        except OSError as error:
            raise InputError(
                f"port {port} cannot be used: {error.strerror}; give another with --port"
            ) from error

    @property
    def url(self) -> str:
        return f"http://{_ADDRESS}:{self.server_port}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore the errors of a request, such as of a viewer that disconnects meanwhile."""


class _Request(BaseHTTPRequestHandler):
    server: _Server
    timeout = 10.0  # a request of a page on this machine takes milliseconds
    server_version = "ps4rig"
    sys_version = ""

    def do_GET(self) -> None:
        # Another site may resolve its own name to 127.0.0.1 (DNS rebinding).
        hosts = [f"{name}:{self.server.server_port}" for name in (_ADDRESS, "localhost")]
        if self.headers.get("Host") not in hosts:
            self._answer(421, "text/plain", b"not the address of the preview\n")
            return
        path = self.path.partition("?")[0]
        light = re.fullmatch(r"/light/([0-9]{1,4})\.png", path)
        if path in _FILES:
            name, kind = _FILES[path]
            self._answer(200, kind, (_HERE / name).read_bytes())
        elif path == "/state.json":
            state = json.dumps(self.server.preview.state(), allow_nan=False)
            self._answer(200, "application/json", state.encode())
        elif path == "/overlay.svg" and (svg := self.server.preview.overlay()) is not None:
            self._answer(200, "image/svg+xml", svg)
        elif light and (png := self.server.preview.png(int(light[1]))) is not None:
            self._answer(200, "image/png", png)
        else:
            self._answer(404, "text/plain", b"no such page\n")

    def _answer(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Print nothing: a line for every image would hide the messages of the command."""


@contextmanager
def serving(preview: Preview, port: int) -> Iterator[_Server]:
    """Serve the page from a thread while the block runs; port 0 chooses a free one."""
    server = _Server(preview, port)
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
