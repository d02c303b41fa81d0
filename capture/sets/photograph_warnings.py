"""Warnings about photographs: settings of the camera, rotation, lights and mask."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from classify import Lighting
from classify.base.arrays import BoolArray, FloatMap
from rig.image_metadata import ImageMetadata

if TYPE_CHECKING:
    from .photographs import Photographs

# Largest slant that is warned of. Lights of microscopes and copy stands have 10 degrees and more.
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
    # A camera that looks down may state any orientation, and another one for its calibration.
    if orientation != 1:
        warnings.append(
            f"the photographs were rotated by their EXIF orientation {orientation}; lights, mask "
            "and crop must be those of the rotated image"
        )
    return warnings


def import_warnings(
    photographs: Photographs, lighting: Lighting, mask_path: Path | None, mask: BoolArray | None
) -> Iterator[str]:
    """Warn of a guessed depth, and of exposures, colours, lights and a mask that look wrong."""
    if photographs.depth_guessed_from is not None and photographs.bit_depth != 16:
        yield (
            f"the data are taken for {photographs.bit_depth} bits, because the largest value is "
            f"{photographs.depth_guessed_from}; --bits N sets another depth"
        )
    exposures_ms = photographs.exposures_ms
    if exposures_ms and not _are_equal(exposures_ms):
        yield (
            f"the files state exposures of {min(exposures_ms):.4g} to {max(exposures_ms):.4g} ms; "
            "expose all alike, or give intensities by --lights that contain them"
        )
    change = _colour_change(photographs.colours, len(lighting))
    if change > _MAX_COLOUR_CHANGE:
        yield (
            f"the share of a colour in a pixel differs by {change:.0%} between the photographs, as "
            "by an automatic white balance; fix it, or give DNG"
        )
    largest_slant_deg = float(lighting.slants_deg.max())
    if largest_slant_deg <= _SMALL_SLANT_DEG:
        yield (
            f"all lights stand within {largest_slant_deg:.3g} degrees of the camera's axis, so "
            "that slopes are poorly known; slants are degrees, not radians"
        )
    if mask_path is not None and mask is not None:
        enclosed = _enclosed_black_share(mask)
        if enclosed > mask.mean():
            yield (
                f"{mask_path.name}: the mask is white on {mask.mean():.1%} of the image and "
                f"encloses {enclosed:.1%} that is black; fill the outline if the part is inside"
            )


def _colour_change(colours: Sequence[FloatMap], light_count: int) -> float:
    """Largest change of the share of a colour in a pixel; 0 for grey photographs.

    `colours` are those of the light images, and then of the ambient image if there is one.
    """
    if not colours:
        return 0.0
    ambient = colours[light_count] if len(colours) > light_count else 0.0
    rgb = np.stack(colours[:light_count]) - ambient
    sums = rgb.sum(axis=2, keepdims=True)
    usable = (sums > 3.0 * _MIN_LIGHT).all(axis=(0, 2))  # false for NaN
    if not usable.any():
        return 0.0
    shares = rgb[:, usable] / sums[:, usable]
    # Shading and albedo cancel.
    return float(np.ptp(np.median(shares - shares.mean(axis=0), axis=1), axis=0).max())


def _enclosed_black_share(mask: BoolArray) -> float:
    """Share of the image that is black and surrounded by the white of a mask."""
    # With a black border around the image, the area of its corner is the outside.
    _, areas = cv2.connectedComponents(
        np.pad(~mask, 1, constant_values=True).view(np.uint8), connectivity=4
    )
    return float((areas[1:-1, 1:-1] > areas[0, 0]).mean())


def _are_equal(values: Sequence[float]) -> bool:
    return max(values) <= 1.05 * min(values)  # 1/60 s and 0.017 s are one exposure
