"""`Calibration`: everything that is known of one rig at one setting, with its lights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, FloatMap, Floats
from classify.base.errors import InputError
from classify.images import ImageStack, SensorNoise
from classify.lighting import Lighting
from classify.lights.flat_field import FlatField

from .dark import Dark
from .photon_transfer import Noise


@dataclass(frozen=True, eq=False)
class Scale:
    """Length of a pixel at the plane of the part, and the geometry of the lens."""

    mm_per_px: float
    error: float  # standard error of `mm_per_px`, as a share of it
    camera_matrix: Floats  # (3, 3) of OpenCV's camera model, in pixels
    distortion: Floats | None  # (5,) k1, k2, p1, p2, k3; None if below 0.5 px
    residual_px: float  # rms distance of the corners of the checkerboard from the model
    focal_error: float | None = None  # as a share; None for `nominal_camera_matrix`

    @property
    def focal_px(self) -> float | None:
        """The focal length in pixels, where it was measured."""
        return None if self.focal_error is None else float(self.camera_matrix[0, 0])

    def __post_init__(self) -> None:
        if not 1e-6 <= self.mm_per_px <= 1e3:
            raise InputError(f"scale of {self.mm_per_px:g} mm per px; give 1e-6 to 1000")
        if not (0.0 <= self.error < np.inf and 0.0 <= self.residual_px < np.inf):
            raise InputError(
                f"scale with an error of {self.error:g} and a residual of {self.residual_px:g} px; "
                "give finite numbers of 0 or more"
            )
        if self.camera_matrix.shape != (3, 3) or not np.isfinite(self.camera_matrix).all():
            raise InputError(f"camera matrix is {self.camera_matrix.shape}; give finite (3, 3)")
        distortion = self.distortion
        if distortion is not None and not (
            distortion.shape == (5,) and np.isfinite(distortion).all()
        ):
            raise InputError(f"distortion is {distortion.shape}; give 5 finite coefficients")
        if self.focal_error is not None and not (
            0.0 <= self.focal_error < np.inf and self.camera_matrix[0, 0] > 0.0
        ):
            raise InputError(
                f"focal length of {self.camera_matrix[0, 0]:g} px with an error of "
                f"{self.focal_error:g}; give positive numbers"
            )


def nominal_camera_matrix(frame: tuple[int, int]) -> Floats:
    """Camera matrix for an unknown focal length, which is set to twice the longer side."""
    rows, columns = frame
    focal_px = 2.0 * max(rows, columns)
    middle = 0.5 * (columns - 1), 0.5 * (rows - 1)
    return np.array([[focal_px, 0.0, middle[0]], [0.0, focal_px, middle[1]], [0.0, 0.0, 1.0]])


RESPONSE_STEPS = 256
"""Number of equal steps of pixel value between the points of a `Response`."""


@dataclass(frozen=True, eq=False)
class Response:
    """Linear light for each pixel value of a camera."""

    curve: Floats  # (257,) light, 0 to 1, at k/256 of full scale; never falls
    error: float  # rms error of `curve`, as a share of full scale
    linear: bool  # the camera counts as linear: `curve` is not applied

    def __post_init__(self) -> None:
        curve = self.curve
        if curve.shape != (RESPONSE_STEPS + 1,) or curve.dtype != np.float64:
            raise InputError(
                f"the response is {curve.shape} {curve.dtype}; give ({RESPONSE_STEPS + 1},) float64"
            )
        if not (np.diff(curve) >= 0.0).all() or not 0.0 <= curve[0] < curve[-1] == 1.0:
            raise InputError(
                f"the response goes from {curve[0]:g} to {curve[-1]:g}; give values that start at "
                "0 or above, never fall and end at 1"
            )
        if not 0.0 <= self.error < np.inf:
            raise InputError(f"the response has an error of {self.error:g}; give a share of 0 to 1")

    def linearise(self, image: Array, full_scale: float) -> FloatMap:
        """Pixel values of any shape as linear light with the same full scale, by `curve`."""
        levels = np.linspace(0.0, full_scale, RESPONSE_STEPS + 1)
        if image.dtype.kind == "u":
            # A lookup table of all values of the type takes a tenth of the time of interpolation.
            values = np.arange(np.iinfo(image.dtype).max + 1)
            table = np.interp(values, levels, full_scale * self.curve).astype(np.float32)
            return table.take(image)
        return np.asarray(np.interp(image, levels, full_scale * self.curve), np.float32)


_NEIGHBOURS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]


def _without_hot_pixels(images: Array, hot_pixels: npt.NDArray[np.int32]) -> Array:
    """Replace (n, 2) hot pixels, row and column, of (..., H, W) images by neighbours' medians."""
    rows, columns = images.shape[-2:]
    is_good = np.ones((rows, columns), np.bool_)
    row, column = hot_pixels.T
    is_good[row, column] = False
    # (8, n) neighbours, clipped to the frame; those outside do not count.
    near_row, near_column = hot_pixels.T[:, None] + np.array(_NEIGHBOURS).T[:, :, None]
    inside = (near_row >= 0) & (near_row < rows) & (near_column >= 0) & (near_column < columns)
    near_row, near_column = near_row.clip(0, rows - 1), near_column.clip(0, columns - 1)
    good = inside & is_good[near_row, near_column]
    repaired = good.any(axis=0)
    values = images[..., near_row[:, repaired], near_column[:, repaired]].astype(np.float32)
    medians = np.nanmedian(np.where(good[:, repaired], values, np.float32(np.nan)), axis=-2)
    if images.dtype.kind == "u":
        medians = np.rint(medians)
    corrected = images.copy()
    corrected[..., row[repaired], column[repaired]] = medians.astype(images.dtype)
    return corrected


def _linearised(stack: ImageStack, response: Response, full_scale: float) -> ImageStack:
    """The images and the ambient image in units of light; full scale stays full scale."""
    ambient = None if stack.ambient is None else response.linearise(stack.ambient, full_scale)
    return ImageStack(response.linearise(stack.images, full_scale), ambient)


def _without_offset(images: Array, offset: float, full_scale: float) -> FloatMap:
    """Subtract `offset` from images; saturated pixels stay saturated."""
    raw = images.astype(np.float32)
    return np.where(raw < full_scale, raw - np.float32(offset), raw)


def _offset_in_light(dark: Dark, response: Response | None, full_scale: float) -> float:
    """Offset of a camera after the response, in units of images that saturate at `full_scale`."""
    offset = np.array([dark.offset * full_scale / dark.full_scale])
    if response is not None:
        return float(response.linearise(offset, full_scale)[0])
    return float(offset[0])


def _undistorted(stack: ImageStack, scale: Scale, full_scale: float) -> ImageStack:
    """The images of a lens without distortion, by bilinear interpolation."""
    maps = _source_of_pixels(scale, stack.shape)

    def remap(image: Array) -> Array:
        undistorted = cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        # float32: in uint8 a small interpolation weight would be rounded to 0.
        saturated = (image >= full_scale).astype(np.float32)
        if saturated.any():
            undistorted[cv2.remap(saturated, *maps, cv2.INTER_LINEAR) > 0.0] = image.max()
        return np.asarray(undistorted, image.dtype)

    ambient = None if stack.ambient is None else remap(stack.ambient)
    return ImageStack(np.stack([remap(image) for image in stack.images]), ambient)


def _undistorted_mask(mask: BoolArray, scale: Scale) -> BoolArray:
    """The (H, W) mask moved like the images; false beyond the frame."""
    rows, columns = mask.shape
    maps = _source_of_pixels(scale, (rows, columns))
    undistorted = cv2.remap(mask.astype(np.uint8), *maps, cv2.INTER_NEAREST)
    return np.asarray(undistorted, np.bool_)


def _source_of_pixels(scale: Scale, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Columns and rows of the distorted image from which each pixel comes."""
    rows, columns = shape
    matrix = scale.camera_matrix
    maps = cv2.initUndistortRectifyMap(
        matrix, scale.distortion, None, matrix, (columns, rows), cv2.CV_32FC1
    )
    return maps[0], maps[1]


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
            ambient = None if stack.ambient is None else _without_hot_pixels(stack.ambient, hot)
            stack = ImageStack(_without_hot_pixels(stack.images, hot), ambient)
        response = self._applied_response
        if response is not None:
            stack = _linearised(stack, response, full_scale)
        if self._subtracts_offset(stack.ambient is not None):
            assert dark is not None
            offset = _offset_in_light(dark, response, full_scale)
            stack = ImageStack(_without_offset(stack.images, offset, full_scale), None)
        if self.scale is not None and self.scale.distortion is not None:
            stack = _undistorted(stack, self.scale, full_scale)
        return stack

    def corrected_mask(self, mask: BoolArray) -> BoolArray:
        """Return an (H, W) mask of the frame that fits images which are `corrected`."""
        if self.scale is None or self.scale.distortion is None:
            return mask
        return _undistorted_mask(mask, self.scale)

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
        intensities = configured.intensities if configured.intensities_given else np.empty(0)
        return replace(measured, intensities=intensities)

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
