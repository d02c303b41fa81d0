"""Drawings as PNG, by OpenCV: in a few milliseconds."""

import cv2
import numpy as np
import numpy.typing as npt

from .drawing import Box, Dot, Drawing, Kind, Line, Words

_UInt8Array = npt.NDArray[np.uint8]
# Pixels of the file for each pixel of the drawing, so that it stays sharp in a report.
_SCALE = 2
# Room above for the heading, in pixels of the drawing.
_HEADING = 44
# A control chart has 340 kB without compression and 140 kB at 3; 6 takes twice the time.
_COMPRESSION = (cv2.IMWRITE_PNG_COMPRESSION, 3)
_FONT, _FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.42
# As in `static/statistics.css` in a light room; red, green, blue.
_COLOURS: dict[Kind, tuple[int, int, int]] = {
    "axis": (85, 96, 107), "grid": (225, 229, 233), "text": (22, 25, 29), "series": (11, 92, 173),
    "centre": (85, 96, 107), "limit": (138, 90, 0), "base": (232, 238, 244), "alarm": (178, 60, 0),
    "share": (85, 96, 107), "PASS": (0, 104, 74), "FAIL": (178, 60, 0), "UNKNOWN": (191, 148, 26),
    "ERROR": (138, 28, 107),
}  # fmt: skip


def drawing_png(drawing: Drawing, heading: str, below: str) -> bytes:
    """Return a drawing as a PNG file, under two lines of heading.

    Letters that are not ASCII become question marks: the fonts of OpenCV have no others.
    """
    size = ((drawing.height + _HEADING) * _SCALE, drawing.width * _SCALE, 3)
    image: _UInt8Array = np.full(size, 255, np.uint8)
    _words(image, Words(12, 18 - _HEADING, heading), thickness=2)
    _words(image, Words(12, 36 - _HEADING, below))
    for element in drawing.elements:
        match element:
            case Line(kind, points):
                places = np.array([_place(x, y) for x, y in points], np.int32)
                cv2.polylines(image, [places], False, _bgr(kind), _SCALE, cv2.LINE_AA)
            case Box(kind, x, y, width, height):
                cv2.rectangle(image, _place(x, y), _place(x + width, y + height), _bgr(kind), -1)
            case Dot(kind, x, y, radius):
                place = _place(x, y)
                cv2.circle(image, place, round(_SCALE * radius), _bgr(kind), -1, cv2.LINE_AA)
            case Words():
                _words(image, element)
    return cv2.imencode(".png", image, _COMPRESSION)[1].tobytes()


def _words(image: _UInt8Array, words: Words, thickness: int = 1) -> None:
    text = words.text.encode("ascii", "replace").decode()
    scale = _FONT_SCALE * _SCALE
    (width, _), _ = cv2.getTextSize(text, _FONT, scale, thickness)
    x, y = _place(words.x, words.y)
    x -= {"start": 0, "middle": width // 2, "end": width}[words.anchor]
    cv2.putText(image, text, (x, y), _FONT, scale, _bgr("text"), thickness, cv2.LINE_AA)


def _place(x: float, y: float) -> tuple[int, int]:
    return round(_SCALE * x), round(_SCALE * (y + _HEADING))


def _bgr(kind: Kind) -> tuple[int, int, int]:
    red, green, blue = _COLOURS[kind]
    return blue, green, red
