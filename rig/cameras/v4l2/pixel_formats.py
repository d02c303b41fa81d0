"""Decode a driver's bytes into an image (H, W) of known depth; encode images in some formats.

Pixel values by kind of format:

- grey (GREY, Y10, Y12, Y16): the sensor's value;
- YUYV, UYVY: the luma byte, without the chroma;
- Bayer: the raw mosaic, one value per pixel, NOT demosaiced. An interpolation would invent values
  from which slopes are computed, while the filters' different gains only affect the albedo;
- RGB24, BGR24: luma of BT.601, 0.299 R + 0.587 G + 0.114 B, rounded;
- MJPG: the luma that JPEG stores, decoded; lossy, so it needs `allow_compressed`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from rig.cameras.camera import Pixels
from rig.errors import CameraError

# Luma of black and white in the limited range, and chroma of grey (BT.601).
_BLACK, _WHITE, _NO_COLOUR = 16, 235, 128

_Bytes = npt.NDArray[np.uint8]


class CorruptFrameError(CameraError):
    """A compressed frame that is damaged."""


@dataclass(frozen=True)
class PixelFormat:
    """Memory layout of one FourCC, with its name in ``rig.toml``."""

    name: str
    fourcc: str
    bit_depth: int  # the true one: valid values are below 2^bit_depth
    bytes_per_px: int  # in memory; 0 for a compressed format
    # From rows (H, W * bytes_per_px) without padding, whose memory the image may share; None for a
    # compressed format, which `_from_jpeg` decodes.
    to_pixels: Callable[[_Bytes], Pixels] | None
    # Rows without padding; None for a format that cannot be written.
    to_bytes: Callable[[Pixels], bytes] | None = None

    @property
    def is_compressed(self) -> bool:
        """Whether the format is compressed with loss."""
        return self.to_pixels is None


def decode(
    pixel_format: PixelFormat,
    data: bytearray | bytes,
    width_px: int,
    height_px: int,
    bytes_per_line: int,
) -> Pixels:
    """Decode the image in the filled part of a buffer, whose memory it may share."""
    to_pixels = pixel_format.to_pixels
    if to_pixels is None:
        return _from_jpeg(data, width_px, height_px)
    row_bytes = width_px * pixel_format.bytes_per_px
    stride = bytes_per_line or row_bytes
    if stride < row_bytes:
        raise CameraError(
            f"the driver reports {stride} bytes per line, {pixel_format.name} of {width_px} px "
            f"needs {row_bytes}; use another pixel format"
        )
    # Some drivers omit the padding of the last row.
    shortest, longest = stride * (height_px - 1) + row_bytes, stride * height_px
    if not shortest <= len(data) <= longest:
        raise CameraError(
            f"a {pixel_format.name} frame of {width_px} x {height_px} px has {len(data)} "
            f"bytes instead of {longest}"
        )
    # A view, which never reads the padding of the last row.
    rows: _Bytes = np.lib.stride_tricks.as_strided(
        np.frombuffer(data, np.uint8), (height_px, row_bytes), (stride, 1)
    )
    pixels = to_pixels(rows)
    limit = 1 << pixel_format.bit_depth
    if pixels.dtype == np.uint16 and limit <= int(pixels.max()):
        raise CameraError(
            f"the camera sends values up to {int(pixels.max())} as {pixel_format.name}, which ends "
            f"at {limit - 1}; if they fill 16 bits, set camera.pixel_format = 'Y16'"
        )
    return pixels


def _from_bytes(start: int, step: int) -> Callable[[_Bytes], Pixels]:
    return lambda rows: np.ascontiguousarray(rows[:, start::step])


def _from_words(rows: _Bytes) -> Pixels:
    words: Pixels = np.ascontiguousarray(rows).view(np.dtype("<u2"))
    return words.astype(np.uint16, copy=False)


def _to_bytes(pixels: Pixels) -> bytes:
    return pixels.astype(np.uint8, copy=False).tobytes()


def _to_words(pixels: Pixels) -> bytes:
    return pixels.astype("<u2", copy=False).tobytes()


def _to_luma(place: int) -> Callable[[Pixels], bytes]:
    """Encode grey as luma of the limited range (BT.601) at one of two bytes, without colour."""

    def encode(pixels: Pixels) -> bytes:
        pairs = np.full((*pixels.shape, 2), _NO_COLOUR, np.uint8)
        span = _WHITE - _BLACK
        pairs[..., place] = _BLACK + np.rint(pixels * np.float32(span / 255.0)).astype(np.uint8)
        return pairs.tobytes()

    return encode


def _luma_of(order: Literal["RGB", "BGR"]) -> Callable[[_Bytes], Pixels]:
    def luma(rows: _Bytes) -> Pixels:
        import cv2  # here, so that a configuration is read without loading it

        code = cv2.COLOR_RGB2GRAY if order == "RGB" else cv2.COLOR_BGR2GRAY
        colours = np.ascontiguousarray(rows).reshape(rows.shape[0], -1, 3)
        return cv2.cvtColor(colours, code).astype(np.uint8, copy=False)

    return luma


def _from_jpeg(data: bytearray | bytes, width_px: int, height_px: int) -> Pixels:
    import simplejpeg  # unlike OpenCV it makes the decoder's warnings errors

    try:
        rows, columns, *_ = simplejpeg.decode_jpeg_header(data)
        if (columns, rows) == (width_px, height_px):
            image: _Bytes = simplejpeg.decode_jpeg(data, "gray")[:, :, 0]
            return image
    except ValueError as error:
        raise CorruptFrameError(
            f"an MJPG frame of {len(data)} bytes is damaged: {error}"
        ) from error
    raise CameraError(
        f"an MJPG frame is {columns} x {rows} px instead of {width_px} x {height_px} px"
    )


_BAYER_DEPTHS = ((8, 1, _from_bytes(0, 1)), (10, 2, _from_words), (12, 2, _from_words))
_BAYER_FOURCCS = {
    "SRGGB": ("RGGB", "RG10", "RG12"),
    "SGRBG": ("GRBG", "BA10", "BA12"),
    "SGBRG": ("GBRG", "GB10", "GB12"),
    "SBGGR": ("BA81", "BG10", "BG12"),
}

PIXEL_FORMATS = {
    entry.name: entry
    for entry in (
        PixelFormat("GREY", "GREY", 8, 1, _from_bytes(0, 1), _to_bytes),
        PixelFormat("Y10", "Y10 ", 10, 2, _from_words, _to_words),
        PixelFormat("Y12", "Y12 ", 12, 2, _from_words, _to_words),
        PixelFormat("Y16", "Y16 ", 16, 2, _from_words, _to_words),
        PixelFormat("YUYV", "YUYV", 8, 2, _from_bytes(0, 2), _to_luma(0)),
        PixelFormat("UYVY", "UYVY", 8, 2, _from_bytes(1, 2), _to_luma(1)),
        PixelFormat("RGB24", "RGB3", 8, 3, _luma_of("RGB")),
        PixelFormat("BGR24", "BGR3", 8, 3, _luma_of("BGR")),
        PixelFormat("MJPG", "MJPG", 8, 0, None),
        *(
            PixelFormat(f"{order}{depth}", fourcc, depth, bytes_per_px, to_pixels)
            for order, fourccs in _BAYER_FOURCCS.items()
            for fourcc, (depth, bytes_per_px, to_pixels) in zip(fourccs, _BAYER_DEPTHS, strict=True)
        ),
    )
}
