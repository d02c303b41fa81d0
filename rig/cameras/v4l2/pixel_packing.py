"""Encode pixels as the bytes that a camera would send: the inverse of `pixel_formats`.

It is separate, so that a program that only writes frames does not load OpenCV.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rig.cameras.camera import Pixels

# Luma of the limited range, BT.601: black is 16, white 235.
_BLACK, _WHITE = 16, 235
_NO_COLOUR = 128


@dataclass(frozen=True)
class Packing:
    """Encoding of one pixel format, row after row without padding."""

    fourcc: str
    bytes_per_px: int
    to_bytes: Callable[[Pixels], bytes]


def _bytes(pixels: Pixels) -> bytes:
    return pixels.astype(np.uint8, copy=False).tobytes()


def _words(pixels: Pixels) -> bytes:
    return pixels.astype("<u2", copy=False).tobytes()


def _luma_at(place: int) -> Callable[[Pixels], bytes]:
    def pack(pixels: Pixels) -> bytes:
        rows, columns = pixels.shape
        pairs = np.full((rows, columns, 2), _NO_COLOUR, np.uint8)
        span = _WHITE - _BLACK
        pairs[..., place] = _BLACK + np.rint(pixels * np.float32(span / 255.0)).astype(np.uint8)
        return pairs.tobytes()

    return pack


PACKINGS = {
    "GREY": Packing("GREY", 1, _bytes),
    "Y10": Packing("Y10 ", 2, _words),
    "Y12": Packing("Y12 ", 2, _words),
    "Y16": Packing("Y16 ", 2, _words),
    "YUYV": Packing("YUYV", 2, _luma_at(0)),
    "UYVY": Packing("UYVY", 2, _luma_at(1)),
}
