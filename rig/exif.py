"""The orientation that a camera writes beside the pixels, as EXIF data."""

import struct
from typing import Any

import numpy as np
import numpy.typing as npt

UPRIGHT = 1
_ORIENTATION_TAG = 0x0112
_SHORT = 3
_EXIF = b"Exif\0\0"
_START_OF_SCAN = 0xDA
# Turns by 90 degrees anticlockwise after mirroring left to right (EXIF 2.32, section 4.6.4).
_TURNS = {1: 0, 2: 0, 3: 2, 4: 2, 5: 1, 6: 3, 7: 3, 8: 1}
_MIRRORED = (2, 4, 5, 7)


def exif_orientation(data: bytes) -> int:
    """Orientation, 1 to 8, in EXIF data, which have the form of a TIFF header; 1 if missing."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None or len(data) < 8:
        return UPRIGHT
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    try:
        (count,) = struct.unpack_from(f"{order}H", data, start)
        for entry in range(start + 2, start + 2 + 12 * count, 12):
            tag, kind, _, value = struct.unpack_from(f"{order}HHIH", data, entry)
            if tag == _ORIENTATION_TAG and kind == _SHORT:
                return checked_orientation(value)
    except struct.error:  # the data end early
        return UPRIGHT
    return UPRIGHT


def checked_orientation(value: int) -> int:
    """Return the orientation; other values than 1 to 8 mean that the camera did not know it."""
    return value if value in _TURNS else UPRIGHT


def jpeg_exif(content: bytes) -> bytes:
    """EXIF data of a JPEG, empty if it has none."""
    start = 2
    while content[start : start + 1] == b"\xff" and len(content) >= start + 4:
        kind, length = struct.unpack_from(">BH", content, start + 1)
        if kind == _START_OF_SCAN:
            break
        segment = content[start + 4 : start + 2 + length]
        if kind == 0xE1 and segment.startswith(_EXIF):
            return segment[len(_EXIF) :]
        start += 2 + length
    return b""


def upright(image: npt.NDArray[Any], orientation: int) -> npt.NDArray[Any]:
    """Turn and mirror an image (H, W, ...) as its EXIF orientation says."""
    if orientation in _MIRRORED:
        image = image[:, ::-1]
    return np.ascontiguousarray(np.rot90(image, _TURNS[orientation]))
