"""Decode the pixel formats of GenICam's naming convention (PFNC 2.1 and GigE Vision 1.2).

`Mono10p` packs pixels without gaps, the lowest bits first; the older `Mono10Packed` puts the lowest
bits of two pixels into a byte between them. A Bayer mosaic stays as it is, one value a pixel.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.cameras.camera import Pixels
from rig.errors import CameraError

_Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class _PixelFormat:
    """Depth and packing of one format."""

    bit_depth: int
    bits_in_memory: int
    to_pixels: Callable[[_Bytes], Pixels]


def _words(data: _Bytes) -> Pixels:
    return data.view(np.dtype("<u2")).astype(np.uint16, copy=False)


def _unpacked_12p(data: _Bytes) -> Pixels:
    first, middle, last = data.reshape(-1, 3).T.astype(np.uint16)
    return np.stack([first | (middle & 0xF) << 8, middle >> 4 | last << 4], axis=1).ravel()


def packed_12p(pixels: Pixels) -> bytes:
    """Pixels of 12 bit as `Mono12p`."""
    first, second = pixels.reshape(-1, 2).T
    parts = first & 0xFF, first >> 8 | (second & 0xF) << 4, second >> 4
    return np.stack(parts, axis=1).astype(np.uint8).tobytes()


def _unpacked_10p(data: _Bytes) -> Pixels:
    a, b, c, d, e = data.reshape(-1, 5).T.astype(np.uint16)
    pixels = a | (b & 0x3) << 8, b >> 2 | (c & 0xF) << 6, c >> 4 | (d & 0x3F) << 4, d >> 6 | e << 2
    return np.stack(pixels, axis=1).ravel()


def _gige_unpacked(low_bits: int) -> Callable[[_Bytes], Pixels]:
    mask = (1 << low_bits) - 1

    def unpacked(data: _Bytes) -> Pixels:
        first, low, second = data.reshape(-1, 3).T.astype(np.uint16)
        pixels = first << low_bits | low & mask, second << low_bits | low >> 4 & mask
        return np.stack(pixels, axis=1).ravel()

    return unpacked


_PACKINGS = {
    "8": _PixelFormat(8, 8, lambda data: data),
    "10": _PixelFormat(10, 16, _words),
    "12": _PixelFormat(12, 16, _words),
    "16": _PixelFormat(16, 16, _words),
    "10p": _PixelFormat(10, 10, _unpacked_10p),
    "12p": _PixelFormat(12, 12, _unpacked_12p),
    "10Packed": _PixelFormat(10, 12, _gige_unpacked(2)),
    "12Packed": _PixelFormat(12, 12, _gige_unpacked(4)),
}
FAMILIES = ("Mono", "BayerRG", "BayerGR", "BayerGB", "BayerBG")
PIXEL_FORMATS = {
    f"{family}{packing}": pixel_format
    for family in FAMILIES
    for packing, pixel_format in _PACKINGS.items()
}
# Smallest number of pixels whose bits fill whole bytes in every packing.
_GROUP_PX = 4


def decode(name: str, data: bytes, width_px: int, height_px: int) -> Pixels:
    """The image (H, W) in a complete buffer, whose memory it may share."""
    pixel_format = PIXEL_FORMATS[name]
    count = width_px * height_px
    if count % _GROUP_PX and pixel_format.bits_in_memory % 8:
        raise CameraError(
            f"{name} of {width_px} x {height_px} px does not fill whole groups of {_GROUP_PX} "
            "pixels; set camera.width_px to a multiple of 4"
        )
    expected = count * pixel_format.bits_in_memory // 8
    if len(data) != expected:
        raise CameraError(
            f"a {name} frame of {width_px} x {height_px} px has {len(data)} bytes instead of "
            f"{expected}"
        )
    pixels = pixel_format.to_pixels(np.frombuffer(data, np.uint8)).reshape(height_px, width_px)
    if pixels.dtype == np.uint16 and int(pixels.max()) >> pixel_format.bit_depth:
        raise CameraError(
            f"the camera sends values up to {int(pixels.max())} as {name}, which ends at "
            f"{(1 << pixel_format.bit_depth) - 1}; choose another camera.pixel_format"
        )
    return pixels
