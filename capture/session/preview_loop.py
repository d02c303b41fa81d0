"""The preview of light after light: its images, the layout and the server of its page, its loop."""

import json
import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from capture.maps.pictures import reduced
from classify.base.arrays import BoolArray, Floats
from classify.base.errors import InputError, Ps4rigError
from rig import Frame, HardwareError, Rig, RigConfig, open_rig
from rig.acceptance import MAX_SATURATED_SHARE
from rig.fresh_frame import fresh_frame

# Enough to judge focus and framing where the page shows four images.
_MAX_SIDE_PX = 800
_BINS = 64  # 2^6, see the shift by bit_depth - 6
# BGR; every other pixel is grey.
_SATURATED_COLOUR = (40, 40, 255)


@dataclass(frozen=True, eq=False)
class _PreviewImage:
    """One frame as the page shows it."""

    png: bytes  # at most 800 px wide or high, saturated pixels in red
    sequence: int
    exposed_s: float  # start of exposure on the rig's clock
    mean_share: float
    saturated_share: float
    focus: float  # variance of the Laplacian over the squared mean; highest when sharp
    histogram: tuple[float, ...]  # shares of the pixels, 64 bins


def preview_image(frame: Frame) -> _PreviewImage:
    full_scale = (1 << frame.bit_depth) - 1
    pixels = frame.pixels
    saturated = pixels >= full_scale
    counts = np.bincount((pixels >> max(frame.bit_depth - 6, 0)).ravel(), minlength=_BINS)
    mean = float(pixels.mean())
    detail = cv2.Laplacian(pixels.astype(np.float32), cv2.CV_32F)
    return _PreviewImage(
        png=_png(pixels, saturated, frame.bit_depth),
        sequence=frame.sequence,
        exposed_s=frame.exposure_start_s,
        mean_share=mean / full_scale,
        saturated_share=float(saturated.mean()),
        focus=float(detail.var()) / max(mean, 1.0) ** 2,
        histogram=tuple((counts[:_BINS] / pixels.size).round(5).tolist()),
    )


def _png(
    pixels: npt.NDArray[np.uint8] | npt.NDArray[np.uint16],
    saturated: BoolArray,
    bit_depth: int,
) -> bytes:
    grey = reduced((pixels >> (bit_depth - 8)).astype(np.uint8), longest_px=_MAX_SIDE_PX)
    # A smaller pixel with any saturated share is red, so a single one stays visible.
    saturated_shares = reduced(saturated.astype(np.float32), longest_px=_MAX_SIDE_PX)
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    colour[saturated_shares > 0] = _SATURATED_COLOUR
    _, png = cv2.imencode(".png", colour, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return png.tobytes()


# Images that are smaller than a seventh of the page show neither focus nor framing.
_MIN_SHARE = 1.0 / 7.0
# Least distance of two lights on the page, as a share of the largest offset; nearer ones overlap.
_MIN_GAP = 1e-3


class Places(NamedTuple):
    """Places on the page as shares of its width or height."""

    lights: tuple[tuple[float, float], ...]  # (left, top) of each
    part: tuple[float, float]  # in the middle
    size: float  # width and height of each image


def places_of(directions: Floats) -> Places | None:
    """Place images by the (N, 3) directions of their lights, y up, around the part.

    They are as large as fit beside each other; None if they would be below a seventh of the page.
    """
    offsets = directions[:, :2] * (1.0, -1.0)  # on the page y points down
    reach = np.abs(offsets).max(initial=_MIN_GAP)
    centres = np.vstack([offsets / reach, np.zeros((1, 2))])
    gap = min(np.abs(one - other).max() for one, other in combinations(centres, 2))
    if gap < _MIN_GAP:
        return None
    # In units of an image, whose side is `gap`: images reach half of one beyond their centres.
    low, high = centres.min(axis=0), centres.max(axis=0)
    spans = (high - low) / gap + 1.0
    size = 1.0 / float(spans.max())
    if size < _MIN_SHARE:
        return None
    corners = (centres - 0.5 * (low + high)) * size / gap + 0.5 - 0.5 * size
    *lights, part = [(float(left), float(top)) for left, top in corners.round(4)]
    return Places(tuple(lights), part, round(size, 4))


_Measure = Callable[[Sequence[Frame]], str | None]
# Pause before the rig is opened again: time to plug in a cable.
_RETRY_S = 2.0
# Pause after each image, for the server and the browser.
_PAUSE_S = 0.05
# A person who focuses the lens must not rely on an image older than this.
_MIN_STALE_S = 3.0


@dataclass
class Preview:
    """The newest image under each light, written by one thread and read by others."""

    stale_after_s: float = _MIN_STALE_S  # age at which the page blanks an image
    now_s: Callable[[], float] = time.monotonic  # the clock of the frames' exposure times
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _camera: str = ""
    _simulated: bool = False
    _lights: tuple[str, ...] = ()
    _images: dict[int, _PreviewImage] = field(default_factory=dict)
    _error: str | None = None
    _places: Places | None = None
    _guide: str | None = None
    _measured: str | None = None
    _captured: str | None = None
    _overlays: tuple[str | None, int] = (None, 0)

    def guide(self, text: str, outline_svg: str | None) -> None:
        """Show instructions for the placement, and over each image the required outline."""
        with self._lock:
            self._guide, self._measured = text, None
            self._overlays = (outline_svg, self._overlays[1] + 1)

    def show_measurement(self, text: str) -> None:
        """Show the measurement on the part that lies there now."""
        with self._lock:
            self._measured = text

    def show_set_measurement(self, text: str) -> None:
        """Show the measurement on the previous set."""
        with self._lock:
            self._captured, self._measured = text, None

    def overlay(self) -> bytes | None:
        """Return the outline as an SVG image, None if there is none."""
        svg, _ = self._overlays
        return None if svg is None else svg.encode()

    def note_opened_rig(self, rig: Rig) -> None:
        """Note that the rig was opened, for the first time or again."""
        info = rig.camera.info
        with self._lock:
            self._camera = (
                f"{info.name}, {info.width_px} x {info.height_px} px, {info.bit_depth} bit"
            )
            self._simulated = rig.simulation is not None
            self._places = places_of(rig.lighting.directions)
            tilts_deg = rig.config.lights.tilts_deg
            self._lights = tuple(f"LED {k}, tilt {tilt:g}°" for k, tilt in enumerate(tilts_deg))
            # A fresh frame takes two or three periods.
            round_s = len(self._lights) * (3.0 * info.frame_period_s + _PAUSE_S)
            self.stale_after_s = max(self.stale_after_s, 2.0 * round_s)

    def store_image(self, light: int, image: _PreviewImage) -> None:
        """Store the newest image under a light."""
        with self._lock:
            self._images[light] = image
            self._error = None

    def store_error(self, error: Ps4rigError) -> None:
        """Note an error; the last images stay."""
        with self._lock:
            self._error = str(error)

    def png(self, light: int) -> bytes | None:
        """Return the newest image under a light, None before the first."""
        with self._lock:
            image = self._images.get(light)
        return None if image is None else image.png

    def state(self) -> dict[str, Any]:
        """Return everything but the images, as the page receives it."""
        with self._lock:
            images, now_s = dict(self._images), self.now_s()
            svg, version = self._overlays
            return {
                "camera": self._camera,
                "simulated": self._simulated,
                "error": self._error,
                "stale_after_s": self.stale_after_s,
                "places": None if self._places is None else self._places._asdict(),
                "guide": self._guide,
                "found": self._measured,
                "captured": self._captured,
                "overlay": None if svg is None else version,
                "max_saturated_share": MAX_SATURATED_SHARE,
                "lights": [
                    _figures(name, images.get(k), now_s) for k, name in enumerate(self._lights)
                ],
            }


def show_lights(
    rig: Rig, preview: Preview, stopping: threading.Event, measure: _Measure | None = None
) -> None:
    """Show each light in turn until `stopping` is set.

    After each round, the text that `measure` makes of its frames is shown, unless it is None.
    """
    preview.note_opened_rig(rig)
    while True:
        frames = []
        for light in range(len(rig.lighting)):
            frames.append(fresh_frame(rig, light))
            preview.store_image(light, preview_image(frames[-1]))
            if stopping.wait(_PAUSE_S):
                return
        text = None if measure is None else measure(frames)
        if text is not None:
            preview.show_measurement(text)


def run_preview(
    config: RigConfig,
    preview: Preview,
    stopping: threading.Event,
    measure: _Measure | None = None,
) -> None:
    """Show each light in turn until `stopping` is set, then switch the LEDs off.

    After an error the rig is opened again in 2 s.
    """
    # This loop switches the LEDs, and the page shows ages in real time.
    real_time = {"lights": {"synchronisation": "software"}, "simulation": {"clock": "real"}}
    config = config.with_changes(**real_time)
    while not stopping.is_set():
        try:
            with open_rig(config) as rig:
                show_lights(rig, preview, stopping, measure)
        except HardwareError as error:
            preview.store_error(error)
            stopping.wait(_RETRY_S)


def _figures(name: str, image: _PreviewImage | None, now_s: float) -> dict[str, Any]:
    if image is None:
        return {"name": name, "sequence": None}
    figures = {key: value for key, value in vars(image).items() if key not in ("png", "exposed_s")}
    return {"name": name, "age_s": round(now_s - image.exposed_s, 3), **figures}


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
