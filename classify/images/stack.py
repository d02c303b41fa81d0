"""Images under each light, checked before anything is computed from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from classify.base.arrays import Array, FloatMap, Indices
from classify.base.errors import InputError

_DTYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))

# Squares of larger values, times gains, are out of reach of float32.
_LARGEST = 1e12

Images = Array | Sequence[Array]


@dataclass(frozen=True, eq=False)
class ImageStack:
    """The images of one frame, as kernels read them."""

    images: Array  # (N, H, W) contiguous uint8, uint16 or finite float32
    ambient: Array | None  # (H, W) of the same type, subtracted from each image

    @classmethod
    def checked(cls, images: Images, lights: int, ambient: Array | None = None) -> ImageStack:
        """Check images and ambient image, and make them contiguous."""
        stack = checked_stack(images, lights)
        return cls(stack, None if ambient is None else checked_ambient(ambient, stack))

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = self.images.shape[1:]
        return rows, columns

    @property
    def dark_rows(self) -> Array:
        """(H, W) ambient image, or (1, W) zeros: kernels are compiled for one form."""
        if self.ambient is None:
            return np.zeros((1, self.shape[1]), self.images.dtype)
        return self.ambient

    def raw_at(self, pixels: Indices) -> FloatMap:
        """(N, n) values of pixels with these flat indices."""
        return self.images.reshape(len(self.images), -1).take(pixels, 1).astype(np.float32)

    def values_at(self, pixels: Indices) -> FloatMap:
        """(N, n) values less ambient light of pixels with these flat indices."""
        values = self.raw_at(pixels)
        if self.ambient is not None:
            values -= self.ambient.ravel().take(pixels).astype(np.float32)
        return values

    def materialised(self) -> ImageStack:
        """The stack with values that `DividedStack` divides on access written into its images."""
        return self

    def rows(self, first: int, last: int) -> ImageStack:
        """Some rows of the frame, as contiguous float32."""
        images, dark = self.float_rows(first, last)
        return ImageStack(images, None if self.ambient is None else dark)

    def float_rows(self, first: int, last: int) -> tuple[FloatMap, FloatMap]:
        """(N, last - first, W) images and `dark_rows`, as float32: kernels compile once."""
        dark = self.dark_rows if self.ambient is None else self.ambient[first:last]
        images = self.images[:, first:last].astype(np.float32, order="C")
        return images, dark.astype(np.float32)


def checked_stack(images: Images, lights: int) -> Array:
    """(N, H, W) contiguous uint8, uint16 or finite float32, one image per light."""
    if not isinstance(images, np.ndarray):
        if len(images) == 0:
            raise InputError("no images are given; give one for each light")
        shapes = {np.shape(image) for image in images}
        if len(shapes) > 1:
            sizes = ", ".join(" x ".join(map(str, shape)) for shape in sorted(shapes))
            raise InputError(f"the images differ in size ({sizes}); all must show the same frame")
        # np.stack would convert all to the widest type, so that 255 of 255 became 255 of 65535.
        dtypes = {str(np.asarray(image).dtype) for image in images}
        if len(dtypes) > 1:
            raise InputError(
                f"the images differ in type ({', '.join(sorted(dtypes))}); all must have the same"
            )
        images = np.stack(images)
    if images.ndim != 3 or 0 in images.shape:
        raise InputError(f"images have shape {images.shape}; give (lights, rows, columns)")
    if images.dtype not in _DTYPES:
        raise InputError(f"images are {images.dtype}; give uint8, uint16 or float32")
    if len(images) != lights:
        raise InputError(f"{len(images)} images for {lights} lights; give one image each")
    if len(images) > 255:
        raise InputError(f"{len(images)} lights; at most 255 are handled")
    if images.dtype == np.float32:
        for index, image in enumerate(images):
            _check_values(image, f"image {index}")
    return np.ascontiguousarray(images)


def checked_ambient(ambient: Array, stack: Array) -> Array:
    """(H, W) contiguous, of the shape and type of the images of `stack`."""
    if ambient.shape != stack.shape[1:] or ambient.dtype != stack.dtype:
        raise InputError(
            f"the ambient image is {ambient.shape} {ambient.dtype}, the light images are "
            f"{stack.shape[1:]} {stack.dtype}; they must agree"
        )
    if ambient.dtype == np.float32:
        _check_values(ambient, "the ambient image")
    return np.ascontiguousarray(ambient)


def _check_values(image: FloatMap, name: str) -> None:
    largest = max(float(image.max()), -float(image.min()))
    if not np.isfinite(largest):
        raise InputError(f"{name} contains NaN or infinity; mask or replace them")
    if largest > _LARGEST:
        raise InputError(
            f"{name} contains a value beyond {_LARGEST:g}; divide all images by a number"
        )


@lru_cache(maxsize=32)
def sample_pixels(shape: tuple[int, int], most: int, margin: int = 0) -> Indices:
    """Flat indices of about `most` pixels, even and symmetric, `margin` px from the sides."""
    rows, columns = (max(0, side - 2 * margin) for side in shape)
    step = max(1, math.ceil(math.sqrt(rows * columns / most)))
    grid = (margin + symmetric_samples(rows, step)), (margin + symmetric_samples(columns, step))
    return (grid[0][:, None] * shape[1] + grid[1]).ravel()


@lru_cache(maxsize=32)
def symmetric_samples(size: int, step: int) -> Indices:
    """Indices below `size` at distances of `step`, symmetric about (size - 1) / 2."""
    middle = (size - 1) // 2
    first = middle if size % 2 else min(middle, max(0, middle - (step - 1) // 2))
    lower = np.arange(first, -1, -step)
    return np.union1d(lower, size - 1 - lower)
