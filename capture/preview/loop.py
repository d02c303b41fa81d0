"""The rig's side of the preview: it shows one light after the other, and recovers from errors."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rig import HardwareError, Rig, RigConfig, open_rig
from rig.acceptance import MAX_SATURATED_SHARE
from rig.fresh_frame import fresh_frame

from .preview_image import PreviewImage, preview_image

__all__ = ["Preview", "run_preview"]

# Long enough for a cable to be plugged in again, short enough to wait for.
RETRY_S = 2.0
# Leaves processor time to the server and the browser.
_PAUSE_S = 0.05
# A glance: whoever turns the lens must not turn it by an image older than this.
_MIN_STALE_S = 3.0


@dataclass
class Preview:
    """The newest image under each light; one thread writes it, others read it.

    Attributes
    ----------
    stale_after_s
        Age at which the page blanks an image.
    now_s
        The clock of the frames' exposure times.
    """

    stale_after_s: float = _MIN_STALE_S
    now_s: Callable[[], float] = time.monotonic
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _camera: str = ""
    _simulated: bool = False
    _lights: tuple[str, ...] = ()
    _images: dict[int, PreviewImage] = field(default_factory=dict)
    _error: str | None = None

    def opened(self, rig: Rig) -> None:
        """Note that the rig was opened, for the first time or again."""
        info = rig.camera.info
        with self._lock:
            self._camera = (
                f"{info.name}, {info.width_px} x {info.height_px} px, {info.bit_depth} bit"
            )
            self._simulated = rig.simulation is not None
            tilts_deg = rig.config.lights.tilts_deg
            self._lights = tuple(f"LED {k}, tilt {tilt:g}°" for k, tilt in enumerate(tilts_deg))
            # A fresh frame takes two or three periods.
            round_s = len(self._lights) * (3.0 * info.frame_period_s + _PAUSE_S)
            self.stale_after_s = max(_MIN_STALE_S, 2.0 * round_s)

    def shown(self, light: int, image: PreviewImage) -> None:
        """Replace the image under a light by a newer one."""
        with self._lock:
            self._images[light] = image
            self._error = None

    def failed(self, error: HardwareError) -> None:
        """Note an error; the last images stay, and age."""
        with self._lock:
            self._error = str(error)

    def png(self, light: int) -> bytes | None:
        """Return the newest image under a light, or None if there is none yet."""
        with self._lock:
            image = self._images.get(light)
        return None if image is None else image.png

    def state(self) -> dict[str, Any]:
        """Return everything but the images, as the page receives it."""
        with self._lock:
            images, now_s = dict(self._images), self.now_s()
            return {
                "camera": self._camera,
                "simulated": self._simulated,
                "error": self._error,
                "stale_after_s": self.stale_after_s,
                "max_saturated_share": MAX_SATURATED_SHARE,
                "lights": [
                    _figures(name, images.get(k), now_s) for k, name in enumerate(self._lights)
                ],
            }


def run_preview(config: RigConfig, preview: Preview, stopping: threading.Event) -> None:
    """Show the rig until `stopping` is set; the LEDs are off when this returns or raises.

    A hardware error is shown, and the rig is opened again two seconds later.

    Raises
    ------
    InputError
        If the configuration cannot be used at all.
    """
    # The LEDs are switched from here, and the age of an image is shown to people.
    config = config.with_changes(
        lights={"synchronisation": "software"}, simulation={"clock": "real"}
    )
    while not stopping.is_set():
        try:
            with open_rig(config) as rig:
                preview.opened(rig)
                while not stopping.is_set():
                    _show_each_light(rig, preview, stopping)
        except HardwareError as error:
            preview.failed(error)
            stopping.wait(RETRY_S)


def _show_each_light(rig: Rig, preview: Preview, stopping: threading.Event) -> None:
    for light in range(len(rig.lighting)):
        preview.shown(light, preview_image(fresh_frame(rig, light)))
        if stopping.wait(_PAUSE_S):
            return


def _figures(name: str, image: PreviewImage | None, now_s: float) -> dict[str, Any]:
    if image is None:
        return {"name": name, "sequence": None}
    figures = {key: value for key, value in vars(image).items() if key not in ("png", "exposed_s")}
    return {"name": name, "age_s": round(now_s - image.exposed_s, 3), **figures}
