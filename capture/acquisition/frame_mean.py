"""Images of a set from checked frames; several are averaged to 16 bits."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from capture.sets.metadata import FrameRecord, ImageRecord
from rig import CameraError, CameraInfo, Frame


@dataclass(frozen=True, eq=False)
class SetImage:
    """A light image or an ambient image, (H, W) uint16, and the record of its capture."""

    pixels: npt.NDArray[np.uint16]
    record: ImageRecord


class FrameMean:
    """Mean of `count` frames, which are added one by one; a single frame stays unchanged.

    `records` holds the sequence number and exposure of each frame.
    """

    def __init__(self, info: CameraInfo, count: int) -> None:
        self._full_scale = (1 << info.bit_depth) - 1
        self._count = count
        shape = (info.height_px, info.width_px)
        if count > 1:
            self._total = np.zeros(shape, np.uint32)
            self._saturated = np.zeros(shape, np.bool_)
        self.records: tuple[FrameRecord, ...] = ()

    def add(self, frame: Frame) -> None:
        if self._count == 1:
            # A copy takes a fifth of the time of a sum.
            self._single = frame.pixels.astype(np.uint16)
        else:
            self._total += frame.pixels
            self._saturated |= frame.pixels >= self._full_scale
        record = FrameRecord(
            sequence=frame.sequence,
            exposure_start_s=frame.exposure_start_s,
            exposure_end_s=frame.exposure_end_s,
        )
        self.records = (*self.records, record)

    def image(self) -> npt.NDArray[np.uint16]:
        """The mean, (H, W); that of several frames is stretched to 65535."""
        if self._count == 1:
            return self._single
        scale = 65535.0 / (self._full_scale * self._count)
        mean: npt.NDArray[np.uint16] = np.rint(self._total * scale).astype(np.uint16)
        # The mean of a pixel that saturated once is unknown.
        mean[self._saturated] = 65535
        return mean


def check_frame(frame: Frame, info: CameraInfo, now_s: float) -> None:
    """Reject a frame that the camera did not announce, or that is stamped in the future."""
    rows, columns = frame.pixels.shape
    if (rows, columns, frame.bit_depth) != (info.height_px, info.width_px, info.bit_depth):
        raise CameraError(
            f"the camera sent {columns} x {rows} px of {frame.bit_depth} bit instead of "
            f"{info.width_px} x {info.height_px} px of {info.bit_depth} bit; open it again"
        )
    if not frame.exposure_start_s <= frame.exposure_end_s <= now_s:
        raise CameraError(
            f"frame {frame.sequence} is stamped {frame.exposure_start_s:.6f} to "
            f"{frame.exposure_end_s:.6f} s and arrived at {now_s:.6f} s; the camera's time stamps "
            "are not on the rig's clock: run ps4rig rig latency, or use another camera"
        )
