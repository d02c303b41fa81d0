"""The interface of all cameras, and the frames that they deliver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from rig.errors import CameraError

EXPOSURE_LAG_FRAMES = 3
"""Number of frames after a change of the exposure that may still have the old one.

Sensors apply a new value after one or two frames, USB cameras after one more.
"""

Pixels = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Frame:
    """One image of the camera.

    Attributes
    ----------
    pixels
        (H, W) uint8 or uint16, row 0 at the top.
    bit_depth
        True depth: the sensor saturates at 2^bit_depth - 1.
    exposure_start_s, exposure_end_s
        Times on the rig's monotonic clock; with a rolling shutter, those of the first row.
    sequence
        The camera's number of the frame. A gap is a lost frame.
    is_corrupt
        Whether the driver reports an error of the frame, whose pixels then do not count.
    """

    pixels: Pixels
    bit_depth: int
    exposure_start_s: float
    exposure_end_s: float
    sequence: int
    is_corrupt: bool = False

    def shifted(self, by_s: float) -> Frame:
        """The same frame with its exposure stamped later."""
        start_s, end_s = self.exposure_start_s + by_s, self.exposure_end_s + by_s
        return replace(self, exposure_start_s=start_s, exposure_end_s=end_s)


@dataclass(frozen=True)
class CameraInfo:
    """Properties of every frame of an open camera.

    Attributes
    ----------
    kind, name
        Backend, and the device's own name.
    width_px, height_px, bit_depth
        Size and depth of the frames.
    frame_period_s, exposure_s
        As read back from the camera.
    queue_length
        Number of frames that the driver keeps; all of them may be stale after a switch.
    readout_s
        Longest time from the exposure of the first row to that of the last; None if unknown.
    start_uncertainty_s
        Longest time by which an exposure may start after the frame's `exposure_start_s`.
    gain_e_per_dn, read_noise_dn, black_level_dn
        Noise model of the sensor, None if unknown.
    gain, gamma
        As read back, in the camera's own units; None if the camera does not state them.
    pixel_value_controls
        Further controls that change the pixel value of the same light, by name.
    controls
        All settings for the record, as read back.
    """

    kind: str
    name: str
    width_px: int
    height_px: int
    bit_depth: int
    frame_period_s: float
    exposure_s: float
    queue_length: int
    readout_s: float | None = None
    start_uncertainty_s: float = 0.0
    gain_e_per_dn: float | None = None
    read_noise_dn: float | None = None
    black_level_dn: float | None = None
    gain: float | None = None
    gamma: float | None = None
    pixel_value_controls: Mapping[str, float] = field(default_factory=dict)
    controls: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ListedCamera:
    """A camera of this machine, as its kind lists it without claiming it.

    Attributes
    ----------
    kind, device
        The values for ``camera.kind`` and ``camera.device``.
    name, driver
        As the driver reports them; empty if the camera could not be opened.
    node
        The file that a user needs permission for, None if there is none.
    formats
        One text for each pixel format, with its sizes; also those that cannot be decoded here.
    longest_exposure_ms
        The limit of its exposure, None if unknown.
    config_lines
        Further lines of ``[camera]`` that suit it; empty if it cannot be used.
    problem
        Error of the query, None if it succeeded.
    names
        Further values for ``camera.device``.
    """

    kind: str
    device: str
    name: str = ""
    driver: str = ""
    node: Path | None = None
    formats: tuple[str, ...] = ()
    longest_exposure_ms: float | None = None
    config_lines: tuple[str, ...] = ()
    problem: str | None = None
    names: tuple[str, ...] = ()


def require_exposure(exposure_ms: float, range_ms: tuple[float, float]) -> None:
    """Raise a `CameraError` for an exposure outside of a camera's range."""
    shortest_ms, longest_ms = range_ms
    # The longest exposure is a frame period, which rounding may exceed.
    if not shortest_ms * (1.0 - 1e-9) <= exposure_ms <= longest_ms * (1.0 + 1e-9):
        raise CameraError(
            f"exposure of {exposure_ms:g} ms; the camera takes {shortest_ms:g} to {longest_ms:g} ms"
        )


class Camera(Protocol):
    """An open, streaming camera.

    `read` returns frames in the order of their exposure, the oldest in the driver's queue first.
    The caller decides by `exposure_start_s` whether a frame is fresh.
    """

    @property
    def info(self) -> CameraInfo:
        """Properties of every frame."""

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        """Shortest and longest exposure that `set_exposure` takes; equal if it is fixed."""

    def set_exposure(self, exposure_ms: float) -> None:
        """Change the exposure of later frames; `info` then has the one that was set.

        Frames in the queue and up to `EXPOSURE_LAG_FRAMES` more may have the old exposure. Raises
        `CameraError` if the camera does not keep the value.
        """

    def read(self, timeout_s: float) -> Frame:
        """The next frame; raises `CameraError` if none arrives within `timeout_s`."""

    def close(self) -> None:
        """Stop streaming and release the device; a second call does nothing."""
