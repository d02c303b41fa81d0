"""The input and the output of every solver."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, FloatMap
from classify.images import ImageStack, SensorNoise, noise_of_images, noise_of_sensor
from classify.lighting import Lighting
from classify.lights.near_light import Shear

# Largest standard error of a valid slope. Most surfaces are flatter than that, so that their mean
# slope is a better estimate than a slope with a larger error.
_MAX_SLOPE_ERROR = 0.5
# A pixel below this share of the bright parts of the frame is dark: half of its light can come from
# the lens (veiling glare, 1 to 5 % by ISO 9358) and from the surface around it
# (`shadow_rule.LEAK`). test_validity.py tests it on photographs with dark backdrops.
_DARK = 0.06
# To save time, `strips` does not test pixels whose albedo is above this multiple of the albedo of a
# dark pixel that faces the camera.
_DARK_ALBEDO = 3.0
_SAMPLES = 4096


@dataclass(frozen=True, eq=False)
class Maps:
    """The maps of a solver, each (H, W); see `SurfaceEstimate` for their meaning."""

    p: FloatMap
    q: FloatMap
    albedo: FloatMap
    valid: BoolArray
    dark_counts: npt.NDArray[np.int32]  # (H,) pixels of each row below `Problem.dark_albedo`
    left_out: npt.NDArray[np.uint8] | None  # index of the light; None for the darkest one
    highlights: BoolArray | None  # None if they follow from the prediction of the solution
    repaired: BoolArray
    unlit: npt.NDArray[np.uint8] | None  # marks of `unsolved`, 0 if solved; None if not filled in
    lighting: Lighting  # with the intensities that were used

    def rows(self, first: int, last: int) -> "Maps":
        """Some rows of all maps, to be written."""

        def part(plane: Array | None) -> Any:
            return None if plane is None else plane[first:last]

        return Maps(
            part(self.p), part(self.q), part(self.albedo), part(self.valid), part(self.dark_counts),
            part(self.left_out), part(self.highlights), part(self.repaired), part(self.unlit),
            self.lighting,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Problem:
    """Images under known lights, checked; `sensor_noise` is estimated if None."""

    stack: ImageStack
    lighting: Lighting
    full_scale: float | None
    sensor_noise: SensorNoise | None
    saturation: np.float32  # the least pixel value of saturated pixels
    on_progress: Callable[[float], None] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        return self.stack.shape

    @cached_property
    def directions(self) -> FloatMap:
        """(N, 3) unit light vectors."""
        return self.lighting.directions.astype(np.float32)

    @cached_property
    def shear(self) -> Shear | None:
        """`Shear` of near lights; None for distant lights."""
        return None if self.lighting.positions_px is None else Shear.of(self.lighting)

    @cached_property
    def gains(self) -> FloatMap:
        """(N,) factors from pixel values to units of the albedo."""
        scale = 1.0 if self.full_scale is None else self.full_scale
        return (1.0 / (scale * self.lighting.intensities)).astype(np.float32)

    @cached_property
    def sigma(self) -> float:
        """Standard deviation of an image value times its gain, at a pixel without light."""
        if self.sensor_noise is None:
            return noise_of_images(self.stack, self.gains, self.lighting)
        return noise_of_sensor(self.sensor_noise, self.stack.ambient, self.gains)

    @cached_property
    def noise_coefficients(self) -> FloatMap:
        """(3,) a, b and black of the variance a + b (value - black) of a pixel value."""
        if self.sensor_noise is not None:
            return self.sensor_noise.coefficients()
        a = self.sigma**2 / np.mean(self.gains.astype(np.float64) ** 2)
        return np.array([a, 0.0, 0.0], dtype=np.float32)

    @cached_property
    def sample(self) -> tuple[FloatMap, FloatMap]:
        """See `ImageStack.sample`."""
        return self.stack.sample(_SAMPLES, self.gains)

    @cached_property
    def dark_level(self) -> np.float32:
        """Mean of the values of a pixel, in units of the albedo, below which it is dark."""
        typical = np.maximum(_median(self.sample[1]), 0.0)
        total = float(typical.sum())
        return np.float32(_DARK * float(np.square(typical).sum()) / total if total > 0.0 else 0.0)

    @cached_property
    def dark_albedo(self) -> np.float32:
        """Albedo above which a pixel is not dark, unless it is steeper than most surfaces."""
        return np.float32(_DARK_ALBEDO * self.dark_level / self.directions[:, 2].mean())

    @property
    def frames(self) -> np.float32:
        """Number of frames whose noise is in a value: 2 if an ambient image is subtracted."""
        return np.float32(1.0 if self.stack.ambient is None else 2.0)

    def new_maps(
        self,
        left_out: npt.NDArray[np.uint8] | None = None,
        highlights: BoolArray | None = None,
        repaired: BoolArray | None = None,
        unlit: npt.NDArray[np.uint8] | None = None,
    ) -> Maps:
        """Maps for a solver to write; `repaired` is all False by default."""
        p, q, albedo = (np.empty(self.shape, np.float32) for _ in range(3))
        valid, dark_counts = np.empty(self.shape, np.bool_), np.empty(self.shape[0], np.int32)
        if repaired is None:
            repaired = np.broadcast_to(np.False_, self.shape)
        return Maps(
            p, q, albedo, valid, dark_counts, left_out, highlights, repaired, unlit, self.lighting
        )

    def noise_floor(self, weights: Array) -> np.float32:
        """Least b_z^2 / rho of a valid slope, for b = weights i."""
        return np.float32(self.sigma) * noise_floor_factor(weights)


def _median(values: FloatMap) -> FloatMap:
    """``np.median(values, axis=0)``, 30 times as fast for four lights."""
    if len(values) != 4:
        return np.median(values, axis=0)
    a, b, c, d = values
    low, high = np.minimum(a, b), np.maximum(a, b)
    other_low, other_high = np.minimum(c, d), np.maximum(c, d)
    middle: FloatMap = np.maximum(low, other_low) + np.minimum(high, other_high)
    return np.float32(0.5) * middle


def noise_floor_factor(weights: Array) -> np.float32:
    """Factor c of the limit b_z^2 >= c sigma rho of a valid slope."""
    # At the limit, the standard error of a slope, sigma |weights| rho / b_z^2, is
    # `_MAX_SLOPE_ERROR`.
    return np.float32(np.linalg.norm(weights, axis=1).max() / _MAX_SLOPE_ERROR)
