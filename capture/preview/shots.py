"""What the preview shows of one frame: a picture, a histogram and a few figures."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rig import Frame

__all__ = ["Shot", "shot_of"]

_LONGEST_SIDE_PX = 800
_BINS = 64
# BGR: nothing in a grey picture has this colour.
_SATURATED_COLOUR = (40, 40, 255)


@dataclass(frozen=True, eq=False)
class Shot:
    """The last frame under one light, ready to be sent.

    Attributes
    ----------
    png
        The picture, at most 800 px wide or high, saturated pixels in red.
    sequence
        The frame's number.
    exposed_s
        When its exposure began, on the monotonic clock.
    mean_share, saturated_share
        Mean pixel value, and how many pixels are saturated, of 1.
    focus
        Variance of the Laplacian over the squared mean: it has a maximum where the picture is
        sharp, and is compared with itself only.
    histogram
        How many pixels of 1 are in each of 64 equal parts of the range.
    """

    png: bytes
    sequence: int
    exposed_s: float
    mean_share: float
    saturated_share: float
    focus: float
    histogram: tuple[float, ...]


def shot_of(frame: Frame) -> Shot:
    """What there is to show of a frame."""
    full = (1 << frame.bit_depth) - 1
    pixels = frame.pixels
    saturated = pixels >= full
    counts = np.bincount((pixels >> max(frame.bit_depth - 6, 0)).ravel(), minlength=_BINS)
    mean = float(pixels.mean())
    detail = cv2.Laplacian(pixels.astype(np.float32), cv2.CV_32F)
    return Shot(
        png=_picture(pixels, saturated, frame.bit_depth),
        sequence=frame.sequence,
        exposed_s=frame.exposure_start_s,
        mean_share=mean / full,
        saturated_share=float(saturated.mean()),
        focus=float(detail.var()) / max(mean, 1.0) ** 2,
        histogram=tuple((counts[:_BINS] / pixels.size).round(5).tolist()),
    )


def _picture(
    pixels: npt.NDArray[np.uint8] | npt.NDArray[np.uint16],
    saturated: npt.NDArray[np.bool_],
    bit_depth: int,
) -> bytes:
    grey = (pixels >> (bit_depth - 8)).astype(np.uint8)
    rows, columns = grey.shape
    scale = min(1.0, _LONGEST_SIDE_PX / max(rows, columns))
    if scale < 1.0:
        size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
        # One saturated pixel is to be seen, however small the picture: any share of it counts.
        shares = cv2.resize(saturated.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        saturated = shares > 0
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    picture[saturated] = _SATURATED_COLOUR
    _, png = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return png.tobytes()
