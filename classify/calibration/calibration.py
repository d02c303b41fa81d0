"""`Calibration`: everything that is known of one rig at one setting, with its lights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from classify.base.arrays import BoolArray, Floats
from classify.base.errors import InputError
from classify.images import ImageStack, SensorNoise
from classify.lighting import Lighting
from classify.lights.flat_field import FlatField

from .correction import (
    Response,
    Scale,
    linearised,
    offset_in_light,
    undistorted,
    undistorted_mask,
    without_hot_pixels,
    without_offset,
)
from .dark import Dark
from .photon_transfer import Noise

_Source = Literal["plate", "mirror sphere", "matte sphere", "list"]


@dataclass(frozen=True, eq=False)
class CalibratedLights:
    """The N lights of a rig with their uncertainties."""

    lighting: Lighting  # directions from the middle of the frame; positions where known
    source: _Source  # what they were measured with; "list" for a file of directions
    direction_errors_deg: Floats  # (N,) standard errors
    distance_errors: Floats | None  # (N,) relative; None for distant lights
    residual: float  # rms misfit of the model, as a share of the signal
    lobe_exponent: float | None  # m of the strength cos^m at an angle to an LED's axis

    def __post_init__(self) -> None:
        if self.source not in get_args(_Source):
            raise InputError(
                f"lights from {self.source!r}; known are {', '.join(get_args(_Source))}"
            )
        for name, errors in (
            ("direction errors", self.direction_errors_deg),
            ("distance errors", self.distance_errors),
        ):
            if errors is not None and (
                errors.shape != (len(self.lighting),)
                or not np.isfinite(errors).all()
                or errors.min() < 0.0
            ):
                raise InputError(
                    f"{name} are {errors.tolist()}; give one of 0 or more for each of "
                    f"{len(self.lighting)} lights"
                )
        exponent = 0.0 if self.lobe_exponent is None else self.lobe_exponent
        if not (0.0 <= self.residual < np.inf and 0.0 <= exponent < np.inf):
            raise InputError(
                f"lights with a residual of {self.residual:g} and a lobe exponent of {exponent:g}; "
                "both are 0 or more"
            )


@dataclass(frozen=True, eq=False)
class Calibration:
    """The measured parts of a calibration; a part that was not measured is None."""

    dark: Dark | None = None
    response: Response | None = None
    noise: Noise | None = None
    flat_field: FlatField | None = None
    lights: CalibratedLights | None = None
    scale: Scale | None = None

    @property
    def mm_per_px(self) -> float | None:
        """Length of a pixel at the plane of the part; None if it was not measured."""
        return None if self.scale is None else self.scale.mm_per_px

    def at(self, exposure_ms: float | None) -> Calibration:
        """Return this calibration for images of one exposure.

        Raises
        ------
        InputError
            If the dark part does not hold for the exposure.
        """
        return self if self.dark is None else replace(self, dark=self.dark.at(exposure_ms))

    def holding_at(self, exposure_ms: float | None) -> Calibration:
        """Return `at`, without a dark part that does not hold for the exposure.

        For images with an ambient image, which need hot pixels of the dark part only.
        """
        holds = self.dark is not None and self.dark.holds_at(exposure_ms)
        return self.at(exposure_ms) if holds else replace(self, dark=None)

    def corrected(self, stack: ImageStack, full_scale: float) -> ImageStack:
        """Return the images as an ideal camera would have taken them.

        Hot pixels are replaced by the median of their good neighbours, pixel values are made linear
        in light, the offset of the camera is subtracted where there is no ambient image, which
        contains it, and the distortion of the lens is removed. Saturated pixels stay at
        `full_scale`. The flat field is not applied: the solver divides by it.

        Parameters
        ----------
        stack
            Images of the camera. They are returned as they are if there is nothing to correct.
        full_scale
            Pixel value of saturation.

        Raises
        ------
        InputError
            If a hot pixel is outside of the frame.
        """
        dark = self._dark_at_one_exposure
        if dark is not None and dark.hot_pixels.size:
            hot = dark.hot_pixels
            outside = hot[(hot >= stack.shape).any(axis=1)]
            if len(outside):
                row, column = outside[0].tolist()
                raise InputError(
                    f"a hot pixel of the calibration, row {row}, column {column}, is outside of "
                    f"images of {stack.shape[1]} x {stack.shape[0]} px; use a calibration of this "
                    "frame size"
                )
            ambient = None if stack.ambient is None else without_hot_pixels(stack.ambient, hot)
            stack = ImageStack(without_hot_pixels(stack.images, hot), ambient)
        response = self._applied_response
        if response is not None:
            stack = linearised(stack, response, full_scale)
        if self._subtracts_offset(stack.ambient is not None):
            assert dark is not None
            offset = offset_in_light(dark, response, full_scale)
            stack = ImageStack(without_offset(stack.images, offset, full_scale), None)
        if self.scale is not None and self.scale.distortion is not None:
            stack = undistorted(stack, self.scale, full_scale)
        return stack

    def corrected_mask(self, mask: BoolArray) -> BoolArray:
        """Return an (H, W) mask of the frame that fits images which are `corrected`."""
        if self.scale is None or self.scale.distortion is None:
            return mask
        return undistorted_mask(mask, self.scale)

    def lighting_of(self, configured: Lighting) -> Lighting:
        """Return the measured lights, with the intensities of those that were configured.

        Raises
        ------
        InputError
            For another number of lights.
        """
        if self.lights is None:
            return configured
        measured = self.lights.lighting
        if len(measured) != len(configured):
            raise InputError(
                f"the calibration is of {len(measured)} lights, the images are of "
                f"{len(configured)}; use a calibration of these lights"
            )
        given = configured.intensities if configured.intensities_given else np.empty(0)
        return replace(measured, intensities=given)

    def noise_of(self, sensor: SensorNoise | None, *, has_ambient: bool) -> SensorNoise | None:
        """Return the noise of `corrected` images, given the camera's; None if unknown.

        A curved response changes the variance with the pixel value, so the noise is then unknown.
        """
        if sensor is None or self._applied_response is not None:
            return None
        if self._subtracts_offset(has_ambient):
            return replace(sensor, black_level_dn=0.0)
        return sensor

    @property
    def _applied_response(self) -> Response | None:
        return None if self.response is None or self.response.linear else self.response

    @property
    def _dark_at_one_exposure(self) -> Dark | None:
        if self.dark is not None and self.dark.longer is not None:
            raise ValueError("the dark part has several exposures; use Calibration.at")
        return self.dark

    def _subtracts_offset(self, has_ambient: bool) -> bool:
        dark = self._dark_at_one_exposure
        return dark is not None and dark.offset > 0.0 and not has_ambient
