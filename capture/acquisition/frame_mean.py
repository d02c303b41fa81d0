"""Images of a set from checked frames; several are averaged to 16 bits."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from capture.sets.metadata import FrameRecord, ImageRecord
from rig import CameraInfo, Frame


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
