"""What a camera is to the rest of the program, whichever backend it has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntFlag
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

__all__ = ["Camera", "CameraInfo", "Frame", "FrameFlag", "Pixels"]

Pixels = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


class FrameFlag(IntFlag):
    """What the driver says is wrong with a frame; 0 is a good one."""

    GOOD = 0
    CORRUPT = 1


@dataclass(frozen=True, eq=False)
class Frame:
    """One image as it came from the camera.

    Attributes
    ----------
    pixels
        (H, W) uint8 or uint16, row 0 at the top.
    bit_depth
        True depth: the sensor saturates at 2^bit_depth - 1 whatever the width of a word.
    exposure_start_s, exposure_end_s
        On the rig's monotonic clock. Of the first row, where rows are exposed one after the other.
    sequence
        Number the camera gave it. A gap is a frame that was lost.
    flags
        `FrameFlag`.
    """

    pixels: Pixels
    bit_depth: int
    exposure_start_s: float
    exposure_end_s: float
    sequence: int
    flags: FrameFlag = FrameFlag.GOOD


@dataclass(frozen=True)
class CameraInfo:
    """What holds for every frame of an open camera.

    Attributes
    ----------
    kind, name
        Backend, and the device's own name.
    width_px, height_px, bit_depth
        Of the frames.
    frame_period_s, exposure_s
        As read back from the camera.
    queue_length
        Frames the driver keeps: as many may be older than the last request.
    readout_s
        From the exposure of the first row to that of the last, at most; None where nobody knows.
    start_known_to_s
        By how much later than a frame's `exposure_start_s` its exposure may have begun.
    gain_e_per_dn, read_noise_dn, black_level_dn
        Noise model of the sensor, None where it is not known.
    controls
        All further settings, as read back.
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
    start_known_to_s: float = 0.0
    gain_e_per_dn: float | None = None
    read_noise_dn: float | None = None
    black_level_dn: float | None = None
    controls: Mapping[str, Any] = field(default_factory=dict)


class Camera(Protocol):
    """An open, streaming camera.

    `read` hands out frames in the order of their exposure, the oldest in the driver's queue first.
    It is the caller who decides by `exposure_start_s` whether a frame is new enough.
    """

    @property
    def info(self) -> CameraInfo:
        """What holds for every frame."""

    def read(self, timeout_s: float) -> Frame:
        """The next frame; raises `CameraError` when none comes within `timeout_s`."""

    def close(self) -> None:
        """Stop streaming and release the device; a second call does nothing."""
