"""Corrections of images: response of the camera, geometry of the lens, hot pixels and offset."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, FloatMap, Floats
from classify.base.errors import InputError
from classify.images import ImageStack

from .dark import Dark


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
            # A table of all values of the type takes a tenth of the time of interpolation.
            values = np.arange(np.iinfo(image.dtype).max + 1)
            table = np.interp(values, levels, full_scale * self.curve).astype(np.float32)
            return table.take(image)
        return np.asarray(np.interp(image, levels, full_scale * self.curve), np.float32)


_NEIGHBOURS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]


def without_hot_pixels(images: Array, hot_pixels: npt.NDArray[np.int32]) -> Array:
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


def linearised(stack: ImageStack, response: Response, full_scale: float) -> ImageStack:
    """The images and the ambient image in units of light; full scale stays full scale."""
    ambient = None if stack.ambient is None else response.linearise(stack.ambient, full_scale)
    return ImageStack(response.linearise(stack.images, full_scale), ambient)


def without_offset(images: Array, offset: float, full_scale: float) -> FloatMap:
    """Subtract `offset` from images; saturated pixels stay saturated."""
    raw = images.astype(np.float32)
    return np.where(raw < full_scale, raw - np.float32(offset), raw)


def offset_in_light(dark: Dark, response: Response | None, full_scale: float) -> float:
    """Offset of a camera after the response, in units of images that saturate at `full_scale`."""
    offset = np.array([dark.offset * full_scale / dark.full_scale])
    if response is not None:
        return float(response.linearise(offset, full_scale)[0])
    return float(offset[0])


def undistorted(stack: ImageStack, scale: Scale, full_scale: float) -> ImageStack:
    """The images of a lens without distortion, by bilinear interpolation."""
    maps = _source_of_pixels(scale, stack.shape)

    def remap(image: Array) -> Array:
        moved = cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        # float32: in uint8 a small interpolation weight would be rounded to 0.
        saturated = (image >= full_scale).astype(np.float32)
        if saturated.any():
            moved[cv2.remap(saturated, *maps, cv2.INTER_LINEAR) > 0.0] = image.max()
        return np.asarray(moved, image.dtype)

    ambient = None if stack.ambient is None else remap(stack.ambient)
    return ImageStack(np.stack([remap(image) for image in stack.images]), ambient)


def undistorted_mask(mask: BoolArray, scale: Scale) -> BoolArray:
    """The (H, W) mask moved like the images; false beyond the frame."""
    rows, columns = mask.shape
    maps = _source_of_pixels(scale, (rows, columns))
    moved = cv2.remap(mask.astype(np.uint8), *maps, cv2.INTER_NEAREST)
    return np.asarray(moved, np.bool_)


def _source_of_pixels(scale: Scale, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Columns and rows of the distorted image from which each pixel comes."""
    rows, columns = shape
    matrix = scale.camera_matrix
    maps = cv2.initUndistortRectifyMap(
        matrix, scale.distortion, None, matrix, (columns, rows), cv2.CV_32FC1
    )
    return maps[0], maps[1]
