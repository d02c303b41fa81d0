"""The rig's side of the preview: light after light, frame after frame, and again after an error."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from typing import Any

from rig import HardwareError, Rig, RigConfig, open_rig
from rig.fresh_frame import fresh_frame

from .shots import Shot, shot_of

__all__ = ["Preview", "run_preview"]

RETRY_S = 2.0
# Leaves the machine time for its viewers.
_PAUSE_S = 0.05
_LEAST_STALE_S = 3.0


@dataclass
class Preview:
    """What viewers are shown, the newest only; written by one thread and read by others."""

    stale_after_s: float = _LEAST_STALE_S
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _camera: str = ""
    _simulated: bool = False
    _lights: tuple[str, ...] = ()
    _shots: dict[int, Shot] = field(default_factory=dict)
    _error: str | None = None

    def opened(self, rig: Rig) -> None:
        """The link to the rig is there, for the first time or again."""
        info = rig.camera.info
        with self._lock:
            self._camera = (
                f"{info.name}, {info.width_px} x {info.height_px} px, {info.bit_depth} bit"
            )
            self._simulated = rig.simulation is not None
            tilts_deg = rig.config.lights.tilts_deg
            self._lights = tuple(f"LED {k}, tilt {tilt:g}°" for k, tilt in enumerate(tilts_deg))
            # A light's turn comes every two or three periods per light.
            turn_s = len(self._lights) * (3.0 * info.frame_period_s + _PAUSE_S)
            self.stale_after_s = max(_LEAST_STALE_S, 2.0 * turn_s)

    def shown(self, light: int, shot: Shot) -> None:
        """There is a newer frame under a light."""
        with self._lock:
            self._shots[light] = shot
            self._error = None

    def failed(self, error: HardwareError) -> None:
        """The rig does not answer; what it showed stays, and grows old."""
        with self._lock:
            self._error = str(error)

    def picture(self, light: int) -> bytes | None:
        """The newest picture under a light as PNG."""
        with self._lock:
            shot = self._shots.get(light)
        return None if shot is None else shot.png

    def state(self) -> dict[str, Any]:
        """All but the pictures, as it goes to the page."""
        with self._lock:
            shots, now_s = dict(self._shots), time.monotonic()
            return {
                "camera": self._camera,
                "simulated": self._simulated,
                "error": self._error,
                "stale_after_s": self.stale_after_s,
                "lights": [
                    _account(name, shots.get(k), now_s) for k, name in enumerate(self._lights)
                ],
            }


def run_preview(config: RigConfig, preview: Preview, stopping: threading.Event) -> None:
    """Show the rig until `stopping` is set; the LEDs are out when this returns or raises.

    What the hardware does not do is shown, and the rig opened again after two seconds.

    Raises
    ------
    InputError
        If the configuration cannot be used at all.
    """
    # It is we who switch; and a picture's age is in the time of those who look at it.
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
        preview.shown(light, shot_of(fresh_frame(rig, light)))
        if stopping.wait(_PAUSE_S):
            return


def _account(name: str, shot: Shot | None, now_s: float) -> dict[str, Any]:
    if shot is None:
        return {"name": name, "sequence": None}
    return {
        "name": name,
        "sequence": shot.sequence,
        "age_s": round(now_s - shot.exposed_s, 3),
        "mean_share": shot.mean_share,
        "saturated_share": shot.saturated_share,
        "focus": shot.focus,
        "histogram": shot.histogram,
    }
