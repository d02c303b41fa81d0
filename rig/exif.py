"""Orientation and exposure time that a camera writes beside the pixels, as EXIF data."""

import math
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

UPRIGHT = 1
# Tags and types of EXIF 2.32, sections 4.6.3 to 4.6.5.
_ORIENTATION_TAG, _DIRECTORY_TAG, _EXPOSURE_TAG = 0x0112, 0x8769, 0x829A
_SHORT, _LONG, _RATIONAL = 3, 4, 5
_EXIF = b"Exif\0\0"
_START_OF_SCAN = 0xDA
# Turns by 90 degrees anticlockwise after mirroring left to right (EXIF 2.32, section 4.6.4).
_TURNS = {1: 0, 2: 0, 3: 2, 4: 2, 5: 1, 6: 3, 7: 3, 8: 1}
_MIRRORED = (2, 4, 5, 7)


def exif_orientation(data: bytes) -> int:
    """Orientation, 1 to 8, in EXIF data; 1 if missing.

    EXIF data have the form of a TIFF header.
    """
    value = _first_value(data, (_ORIENTATION_TAG, _SHORT))
    return UPRIGHT if value is None else checked_orientation(int(value))


def exif_exposure_ms(data: bytes) -> float | None:
    """Exposure time in EXIF data; None if missing or not a positive number."""
    seconds = _first_value(data, (_DIRECTORY_TAG, _LONG), (_EXPOSURE_TAG, _RATIONAL))
    return 1e3 * seconds if seconds is not None and 0.0 < seconds < math.inf else None


def _first_value(data: bytes, *path: tuple[int, int]) -> float | None:
    """Return the value at a path of (tag, type); all but the last lead to directories."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None:
        return None
    value: float | None = None
    try:
        (start,) = struct.unpack_from(f"{order}I", data, 4)
        for wanted in path:
            value = None
            (count,) = struct.unpack_from(f"{order}H", data, start)
            for entry in range(start + 2, start + 2 + 12 * count, 12):
                if struct.unpack_from(f"{order}HH", data, entry) == wanted:
                    value = _value_at(data, order, entry + 8, wanted[1])
                    break
            if value is None:
                return None
            start = int(value)
    except struct.error:  # the data end early
        return None
    return value


def _value_at(data: bytes, order: str, place: int, kind: int) -> float | None:
    if kind == _SHORT:
        return float(struct.unpack_from(f"{order}H", data, place)[0])
    (value,) = struct.unpack_from(f"{order}I", data, place)
    if kind == _LONG:
        return float(value)
    numerator, denominator = struct.unpack_from(f"{order}II", data, value)
    return numerator / denominator if denominator else None


def checked_orientation(value: int) -> int:
    """Return an orientation of 1 to 8 as it is, and 1 for another value.

    A camera that does not know the orientation writes another value.
    """
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
