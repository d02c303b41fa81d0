"""The preview of one frame: an image, a histogram and a few figures."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rig import Frame

# Enough to judge focus and framing where the page shows four images.
_LONGEST_SIDE_PX = 800
_BINS = 64  # 2^6, see the shift by bit_depth - 6
# BGR; every other pixel is grey.
_SATURATED_COLOUR = (40, 40, 255)


@dataclass(frozen=True, eq=False)
class PreviewImage:
    """One frame as the page shows it."""

    png: bytes  # at most 800 px wide or high, saturated pixels in red
    sequence: int
    exposed_s: float  # start of exposure on the rig's clock
    mean_share: float
    saturated_share: float
    focus: float  # variance of the Laplacian over the squared mean; highest when sharp
    histogram: tuple[float, ...]  # shares of the pixels, 64 bins


def preview_image(frame: Frame) -> PreviewImage:
    full_scale = (1 << frame.bit_depth) - 1
    pixels = frame.pixels
    saturated = pixels >= full_scale
    counts = np.bincount((pixels >> max(frame.bit_depth - 6, 0)).ravel(), minlength=_BINS)
    mean = float(pixels.mean())
    detail = cv2.Laplacian(pixels.astype(np.float32), cv2.CV_32F)
    return PreviewImage(
        png=_png(pixels, saturated, frame.bit_depth),
        sequence=frame.sequence,
        exposed_s=frame.exposure_start_s,
        mean_share=mean / full_scale,
        saturated_share=float(saturated.mean()),
        focus=float(detail.var()) / max(mean, 1.0) ** 2,
        histogram=tuple((counts[:_BINS] / pixels.size).round(5).tolist()),
    )


def _png(
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
        # A smaller pixel with any saturated share is red, so a single one stays visible.
        shares = cv2.resize(saturated.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        saturated = shares > 0
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    colour[saturated] = _SATURATED_COLOUR
    _, png = cv2.imencode(".png", colour, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return png.tobytes()
