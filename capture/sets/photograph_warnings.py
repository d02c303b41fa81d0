"""Warnings about photographs: settings of the camera, rotation, lights and mask."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from classify import Lighting
from classify.base.arrays import BoolArray, FloatMap
from rig.image_metadata import ImageMetadata

# Slant up to which a warning comes. Lights of microscopes and copy stands have 10 degrees and more.
_SMALL_SLANT_DEG = 5.0
# Largest difference of the share of red, green or blue in a pixel under two lights. White balances
# that differ by 10 to 20 % in red and blue change it by 0.07, and normals by 1.6 degrees.
_MAX_COLOUR_CHANGE = 0.02
_MIN_LIGHT = 0.02  # of full scale; less is noise


def file_warnings(metadata: Sequence[ImageMetadata]) -> list[str]:
    """Warn of settings of the camera that differ between photographs, and of a rotation."""
    isos = [file.iso for file in metadata if file.iso is not None]
    f_numbers = [file.f_number for file in metadata if file.f_number is not None]
    warnings = [
        f"the files state {name} of {min(values):.4g} to {max(values):.4g}; use one for all"
        for name, values in (("ISO values", isos), ("F-numbers", f_numbers))
        if values and not _are_equal(values)
    ]
    orientation = metadata[0].orientation
    # A camera that looks down may state any orientation, another one for its calibration.
    if orientation != 1:
        text = f"the photographs were rotated by their EXIF orientation {orientation}; lights, mask"
        warnings.append(f"{text} and crop must be those of the rotated image")
    return warnings


def exposure_warnings(exposures_ms: Sequence[float]) -> list[str]:
    """Warn of exposure times that differ."""
    if not exposures_ms or _are_equal(exposures_ms):
        return []
    text = f"the files state exposures of {min(exposures_ms):.4g} to {max(exposures_ms):.4g} ms"
    return [f"{text}; expose all alike, or give intensities by --lights that contain them"]


def colour_warnings(colours: Sequence[FloatMap], count: int) -> list[str]:
    """Warn if pixels have another colour under some of `count` lights; an ambient image follows."""
    if not colours:
        return []
    rgb = np.stack(colours[:count]) - (colours[count] if len(colours) > count else 0.0)
    sums = rgb.sum(axis=2, keepdims=True)
    usable = (sums > 3.0 * _MIN_LIGHT).all(axis=(0, 2))  # false for NaN
    if not usable.any():
        return []
    shares = rgb[:, usable] / sums[:, usable]
    # Shading and albedo cancel.
    change = float(np.ptp(np.median(shares - shares.mean(axis=0), axis=1), axis=0).max())
    if change <= _MAX_COLOUR_CHANGE:
        return []
    text = (
        f"the share of a colour in a pixel differs by {change:.0%} between the photographs, as by"
    )
    return [f"{text} an automatic white balance; fix it, or give DNG"]


def slant_warnings(lighting: Lighting) -> list[str]:
    """Warn of lights near the camera's axis."""
    largest_deg = float(lighting.slants_deg.max())
    if largest_deg > _SMALL_SLANT_DEG:
        return []
    text = f"all lights stand within {largest_deg:.3g} degrees of the camera's axis, so that slopes"
    return [f"{text} are poorly known; slants are degrees, not radians"]


def outline_warnings(path: Path | None, mask: BoolArray | None) -> list[str]:
    """Warn of a mask that encloses more black than it has white."""
    if path is None or mask is None:
        return []
    # Black areas, with a black border around the image: the area of a corner is the outside.
    _, areas = cv2.connectedComponents(
        np.pad(~mask, 1, constant_values=True).view(np.uint8), connectivity=4
    )
    enclosed = float((areas[1:-1, 1:-1] > areas[0, 0]).mean())
    if enclosed <= mask.mean():
        return []
    text = f"{path.name}: the mask is white on {mask.mean():.1%} of the image and encloses"
    return [f"{text} {enclosed:.1%} that is black; fill the outline if the part is inside"]


def _are_equal(values: Sequence[float]) -> bool:
    return max(values) <= 1.05 * min(values)  # 1/60 s and 0.017 s are one exposure
