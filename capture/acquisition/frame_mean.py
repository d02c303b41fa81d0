"""One image from the frames of one light: checked, summed, and the mean at the full 16 bits."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from capture.sets.metadata import FrameRecord
from rig import CameraError, CameraInfo, Frame

__all__ = ["FrameMean", "check_frame"]


class FrameMean:
    """The mean of `count` frames, added one by one; of one frame, that frame."""

    def __init__(self, info: CameraInfo, count: int) -> None:
        self._full_scale = (1 << info.bit_depth) - 1
        self._count = count
        self._total = np.zeros((info.height_px, info.width_px), dtype=np.uint32)
        self._saturated = np.zeros(self._total.shape, dtype=np.bool_)
        self._records: list[FrameRecord] = []

    def add(self, frame: Frame) -> None:
        """Take a frame in."""
        self._total += frame.pixels
        self._saturated |= frame.pixels >= self._full_scale
        self._records.append(
            FrameRecord(
                sequence=frame.sequence,
                exposure_start_s=frame.exposure_start_s,
                exposure_end_s=frame.exposure_end_s,
            )
        )

    @property
    def records(self) -> tuple[FrameRecord, ...]:
        """What is known of the frames."""
        return tuple(self._records)

    def image(self) -> npt.NDArray[np.uint16]:
        """(H, W). The mean of several is stretched to 65535."""
        if self._count == 1:
            return self._total.astype(np.uint16)
        scale = 65535.0 / (self._full_scale * self._count)
        mean: npt.NDArray[np.uint16] = np.rint(self._total * scale).astype(np.uint16)
        # A pixel that saturated once has no mean.
        mean[self._saturated] = 65535
        return mean


def check_frame(frame: Frame, info: CameraInfo, now_s: float) -> None:
    """Refuse a frame that the camera did not announce, or that cannot have been exposed yet.

    Raises
    ------
    CameraError
        For another size or depth, or times that are not on the rig's clock.
    """
    rows, columns = frame.pixels.shape
    if (rows, columns, frame.bit_depth) != (info.height_px, info.width_px, info.bit_depth):
        raise CameraError(
            f"the camera sent {columns} x {rows} px of {frame.bit_depth} bit, it had announced "
            f"{info.width_px} x {info.height_px} of {info.bit_depth}"
        )
    if not frame.exposure_start_s <= frame.exposure_end_s <= now_s:
        raise CameraError(
            f"frame {frame.sequence} claims an exposure from {frame.exposure_start_s:.6f} to "
            f"{frame.exposure_end_s:.6f} s and came at {now_s:.6f} s; the camera's time stamps "
            "are not on the rig's clock"
        )
