"""Rules for every request: host, origin, size and time; headers of answers."""

import asyncio
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from urllib.parse import parse_qsl, urlsplit

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

# Size of a request's body. The largest form, the settings of a recipe with a reason, has 4 kB.
MAX_BODY_BYTES = 64 * 1024
# Time for a body to arrive. 64 kB take 0.1 s at 5 Mbit/s.
BODY_S = 5.0
# Number of fields of a form: 100 textures with ten settings each, and the other settings.
MAX_FIELDS = 1200
STATIC_PATH = "/static"

_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
        "connect-src 'self'; form-action 'self'; frame-ancestors 'none'; base-uri 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    # Not "no-referrer", with which browsers send forms with "Origin: null".
    "Referrer-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}


class Denied(HTTPException):
    """A request that is not served, as status, message and headers."""

    def __str__(self) -> str:
        return self.detail


class Slots:
    """Limits the requests of a kind that run at a time; further ones are answered 503."""

    def __init__(self, count: int, busy: str) -> None:
        self._free, self._busy = threading.BoundedSemaphore(count), f"{count} {busy}"

    @contextmanager
    def slot(self) -> Iterator[None]:
        """Hold a slot during the block."""
        if not self._free.acquire(blocking=False):
            raise Denied(503, self._busy, {"Retry-After": "2"})
        try:
            yield
        finally:
            self._free.release()


def is_own_host(host_header: str, server_address: str, names: Collection[str]) -> bool:
    """Whether a request with this header Host may be served: against DNS rebinding.

    It was received at `server_address`; `names` are in lower case, from ``station.toml``.
    """
    try:
        host = urlsplit(f"//{host_header}").hostname
    except ValueError:
        return False
    if host is None or "@" in host_header or "/" in host_header:
        return False
    # A socket for all addresses, "::", gives IPv4 addresses with this prefix.
    server_address = server_address.removeprefix("::ffff:")
    is_loopback = server_address in ("127.0.0.1", "::1")
    return (
        host in names
        or host == server_address
        or (is_loopback and host in ("localhost", "127.0.0.1", "::1"))
    )


class SecureHeaders:
    """Adds `_HEADERS` to every answer, and refuses hosts other than its own and `names`."""

    def __init__(self, app: ASGIApp, names: Collection[str], *, is_https: bool) -> None:
        self._app, self._names = app, names
        headers = dict(_HEADERS)
        if is_https:
            headers["Strict-Transport-Security"] = "max-age=31536000"
        self._headers = [(key.lower().encode(), value.encode()) for key, value in headers.items()]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                known = {key for key, _ in message["headers"]}
                added = [pair for pair in self._headers if pair[0] not in known]
                if b"cache-control" not in known:
                    # Browsers keep static files and check their hash; they do not store answers,
                    # which may contain secrets.
                    caching = b"no-cache" if scope["path"].startswith(STATIC_PATH) else b"no-store"
                    added.append((b"cache-control", caching))
                message["headers"] = [*message["headers"], *added]
            await send(message)

        if scope["method"] == "HEAD":  # the server leaves the body out
            scope = {**scope, "method": "GET"}
        hosts = [value for key, value in scope["headers"] if key == b"host"]
        address = (scope.get("server") or ("", 0))[0]
        headers = [host.decode("latin-1") for host in hosts]
        if len(headers) != 1 or not is_own_host(headers[0], address, self._names):
            named = ", ".join(repr(header[:100]) for header in headers) or "none"
            text = (
                f"Host {named}: not an address of this station; add it to names in [panel] of "
                "station.toml, or let the proxy pass on the Host that the browser sent\n"
            )
            await PlainTextResponse(text, 421)(scope, receive, send_with_headers)
            return
        await self._app(scope, receive, send_with_headers)


class BodyLimit:
    """Refuses bodies above `MAX_BODY_BYTES` or slower than `BODY_S`."""

    # Bodies of GET are not limited: an event stream reads on to notice that its client has left.

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD"):
            await self._app(scope, receive, send)
            return
        closing = {"Connection": "close"}
        too_large = Denied(413, f"the body has more than {MAX_BODY_BYTES} bytes", closing)
        length = dict(scope["headers"]).get(b"content-length", b"0")
        declared = MAX_BODY_BYTES + 1 if len(length) > 10 else int(length)
        deadline_s, is_complete, count = asyncio.get_running_loop().time() + BODY_S, False, 0

        async def receive_limited() -> Message:
            nonlocal count, is_complete
            if is_complete:
                return await receive()
            if declared > MAX_BODY_BYTES:
                raise too_large
            try:
                async with asyncio.timeout_at(deadline_s):
                    message = await receive()
            except TimeoutError:
                raise Denied(408, f"the body took longer than {BODY_S:g} s", closing) from None
            if message["type"] == "http.disconnect":
                raise Denied(400, "the body is not complete")  # nobody reads this
            count += len(message["body"])
            if count > MAX_BODY_BYTES:
                raise too_large
            is_complete = not message["more_body"]
            return message

        await self._app(scope, receive_limited, send)


def require_same_origin(request: Request) -> None:
    """Check that a change was not sent by a page of another site; only browsers name the site."""
    site = request.headers.get("sec-fetch-site", "same-origin")
    origin = request.headers.get("origin")
    host = request.headers.get("host", "")
    is_same = origin is None or origin.partition("://")[2].lower() == host.lower()
    if site not in ("same-origin", "none") or not is_same:
        raise Denied(
            403,
            f"the request was sent by a page of another site: Host {host[:100]!r}, Origin "
            f"{(origin or 'none')[:100]!r}, Sec-Fetch-Site {site[:20]!r}; a proxy must pass on the "
            "Host that the browser sent (nginx: proxy_set_header Host $http_host)",
        )


def form_of(request: Request, body: bytes) -> dict[str, str]:
    """Return the values of a form; an empty body has none."""
    if not body:
        return {}
    kind = request.headers.get("content-type", "").lower()
    if not kind.startswith("application/x-www-form-urlencoded"):
        raise Denied(415, "the body must be a form")
    try:
        return dict(
            parse_qsl(
                body.decode(), keep_blank_values=True, max_num_fields=MAX_FIELDS, errors="strict"
            )
        )
    except ValueError as error:
        raise Denied(400, f"the body is no form: {error}") from error
