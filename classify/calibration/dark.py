"""The camera without light: offset, hot pixels and noise, from frames with the lens covered."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats
from classify.base.errors import CalibrationRejected, InputError
from classify.images import ROUNDING_VARIANCE

from .photon_transfer import BLOCKS, Frames, in_blocks, temporal_variances

SAME_EXPOSURE = 0.02
"""Largest relative difference of equal exposures, which cameras round when they read them back."""
_MAX_EXPOSURES = 16


@dataclass(frozen=True, eq=False)
class Dark:
    """Offset, noise and hot pixels, in pixel values, at one gain and one exposure or several."""

    offset: float  # without light
    noise: float  # temporal standard deviation of a pixel in one frame
    hot_pixels: npt.NDArray[np.int32]  # (n, 2) rows and columns
    ambient: float | None  # ambient light with all LEDs off, less `offset`; None if unknown
    full_scale: float  # pixel value of saturation to which the values above belong
    exposure_ms: float | None = None  # of the values above; None if unknown
    longer: Dark | None = None  # at the next longer measured exposure; None for the longest

    def __post_init__(self) -> None:
        if not (0.0 < self.full_scale < np.inf and 0.0 <= self.offset < self.full_scale):
            raise InputError(
                f"dark offset {self.offset:g} of full scale {self.full_scale:g}; give "
                "an offset from 0 to below full scale"
            )
        if not 0.0 <= self.noise <= self.full_scale:
            raise InputError(
                f"dark noise {self.noise:g} of full scale {self.full_scale:g}; give 0 to full scale"
            )
        if self.ambient is not None and not abs(self.ambient) <= self.full_scale:
            raise InputError(
                f"ambient light {self.ambient:g} of full scale {self.full_scale:g}; give a value "
                "within full scale"
            )
        pixels = self.hot_pixels
        if pixels.ndim != 2 or pixels.shape[1] != 2 or pixels.dtype != np.int32:
            raise InputError(
                f"hot pixels are {pixels.shape} {pixels.dtype}; give (n, 2) int32 rows and columns"
            )
        if pixels.size and pixels.min() < 0:
            raise InputError(f"a hot pixel has the row or column {pixels.min()}")
        self._check_exposures()

    def _check_exposures(self) -> None:
        times_ms = self.exposures_ms
        if self.exposure_ms is not None and not 0.0 < self.exposure_ms < np.inf:
            raise InputError(f"dark exposure of {self.exposure_ms:g} ms; give one above 0")
        if len(times_ms) > _MAX_EXPOSURES:
            raise InputError(f"{len(times_ms)} dark exposures; give up to {_MAX_EXPOSURES}")
        if self.longer is None:
            return
        # False for an unknown exposure.
        is_rising = (self.exposure_ms or np.inf) < (self.longer.exposure_ms or 0.0)
        if not is_rising:
            raise InputError(f"dark exposures of {times_ms} ms; give known and rising ones")
        if self.longer.full_scale != self.full_scale:
            raise InputError(
                f"dark frames of full scale {self.full_scale:g} and {self.longer.full_scale:g}; "
                "give frames of one depth"
            )

    @property
    def exposures(self) -> tuple[Dark, ...]:
        """Each measured exposure alone, the shortest first."""
        longer = () if self.longer is None else self.longer.exposures
        return (replace(self, longer=None), *longer)

    @property
    def exposures_ms(self) -> tuple[float | None, ...]:
        """The measured exposures, the shortest first."""
        longer = () if self.longer is None else self.longer.exposures_ms
        return (self.exposure_ms, *longer)

    def holds_at(self, exposure_ms: float | None) -> bool:
        """Whether an exposure lies within the measured ones.

        If the exposure or a measured one is unknown: whether only one exposure was measured.
        """
        shortest_ms, longest_ms = self.exposures_ms[0], self.exposures_ms[-1]
        if shortest_ms is None or longest_ms is None or exposure_ms is None:
            return self.longer is None
        rounding = 1.0 + SAME_EXPOSURE
        return shortest_ms / rounding <= exposure_ms <= longest_ms * rounding

    def at(self, exposure_ms: float | None) -> Dark:
        """Interpolate offset, noise variance and hot pixels to one exposure, linearly."""
        if not self.holds_at(exposure_ms):
            if exposure_ms is None:
                raise InputError(
                    f"dark frames {measured_at(self)}, and the images state no exposure; use a "
                    "calibration with one dark exposure"
                )
            raise InputError(
                f"dark frames {measured_at(self)}, not at {exposure_ms:g} ms; ps4rig calibrate "
                "dark at that exposure adds it"
            )
        if self.longer is None or exposure_ms is None:
            return replace(self, longer=None)
        exposures = self.exposures
        for dark in exposures:
            if dark.exposure_ms and abs(exposure_ms / dark.exposure_ms - 1.0) <= SAME_EXPOSURE:
                return dark
        upper = next(
            k for k, dark in enumerate(exposures) if (dark.exposure_ms or 0.0) > exposure_ms
        )
        shorter_dark, longer_dark = exposures[upper - 1], exposures[upper]
        assert shorter_dark.exposure_ms is not None
        assert longer_dark.exposure_ms is not None
        span_ms = longer_dark.exposure_ms - shorter_dark.exposure_ms
        share = (exposure_ms - shorter_dark.exposure_ms) / span_ms

        def interpolated(lower: float, higher: float) -> float:
            return lower + share * (higher - lower)

        ambient = None
        if shorter_dark.ambient is not None and longer_dark.ambient is not None:
            ambient = interpolated(shorter_dark.ambient, longer_dark.ambient)
        return Dark(
            offset=interpolated(shorter_dark.offset, longer_dark.offset),
            noise=math.sqrt(interpolated(shorter_dark.noise**2, longer_dark.noise**2)),
            hot_pixels=np.unique(
                np.concatenate([shorter_dark.hot_pixels, longer_dark.hot_pixels]), axis=0
            ),
            ambient=ambient,
            full_scale=self.full_scale,
            exposure_ms=exposure_ms,
        )

    def with_exposure_of(self, other: Dark) -> Dark:
        """Add the exposure of `other`, which replaces an equal exposure."""
        others = (dark for dark in self.exposures if not other.holds_at(dark.exposure_ms))
        exposures = [*others, other]
        exposures.sort(key=lambda dark: dark.exposure_ms or 0.0, reverse=True)
        merged, *shorter = exposures
        for dark in shorter:
            merged = replace(dark, longer=merged)
        return merged


def measured_at(dark: Dark) -> str:
    """Describe the measured exposures, for messages."""
    times = [f"{time_ms:g}" for time_ms in dark.exposures_ms if time_ms is not None]
    if len(times) < 2:
        return f"were measured at {times[0]} ms only" if times else "were measured"
    return f"were measured from {times[0]} to {times[-1]} ms"


# Deviation of a hot pixel from its block, in standard deviations of one frame (with rounding). A
# smaller deviation disturbs an image less than noise does; the mean of 16 frames of normal noise
# never reaches it.
_HOT_DEVIATIONS = 6.0
# Good industrial sensors have fewer than one hot pixel in a thousand.
_MAX_HOT_SHARE = 0.01
# Shares of full scale. An 8-bit camera of gamma 2.2 with an offset of 1/64 shows 15 % in the dark.
# The glow of a sensor's electronics stays below 1 % at exposures of up to a second. A lens that is
# open in a lit room exceeds `_MAX_OFFSET`, or shows a scene, which exceeds `_MAX_STRUCTURE`.
_MAX_OFFSET, _MAX_STRUCTURE = 0.25, 0.02
# Share of full scale by which a light may raise a block: less than the least signal of an LED.
_MAX_LEAK_SHARE = 0.002
# Standard errors of a difference that is not noise: any of 256 blocks exceeds them by chance in one
# of four million sets.
_SIGNIFICANT_ERRORS = 6.0
# With a larger share of values at 0, offset and noise are those of a clipped distribution: 0.1 % of
# normal noise lies more than 3.1 standard deviations below its mean.
_MAX_CLIPPED_SHARE = 0.001


@dataclass(frozen=True, eq=False)
class DarkFrames:
    """A `Dark`, and further measures of the frames that it is from."""

    dark: Dark
    fixed_pattern: float  # standard deviation of the pixels' offsets, in pixel values
    clipped: float  # share of the values at 0
    frames: int  # number of them

    @property
    def is_clipped(self) -> bool:
        """Whether so many values are 0 that offset and noise of the sensor cannot be measured."""
        return self.clipped > _MAX_CLIPPED_SHARE


def dark_of(frames: Frames, full_scale: float, lit: Frames | None = None) -> DarkFrames:
    """Measure offset, noise and hot pixels from (F, H, W) frames with the lens covered.

    `lit` are frames under the LEDs. They are rejected if they are brighter.
    """
    if len(frames) < 2 or frames.dtype not in (np.uint8, np.uint16):
        count = "one frame" if len(frames) == 1 else f"{len(frames)} frames"
        raise InputError(
            f"{count} of {frames.dtype}; give two or more frames of uint8 or uint16, which show "
            "the noise"
        )
    blocks = in_blocks(frames)
    medians = np.median(blocks.mean(axis=0, dtype=np.float64), axis=1)
    _check_covered(medians, float(full_scale))
    # The median over blocks leaves out those with hot or flickering pixels.
    _, variances, _ = temporal_variances(blocks, np.ones(blocks.shape[1:], np.bool_))
    noise = float(np.sqrt(np.median(variances)))
    if lit is not None:
        _check_unlit(frames, lit, noise, float(full_scale))
    mean = frames.mean(axis=0, dtype=np.float64)
    excess = mean - _per_pixel(medians, mean.shape)
    hot = np.abs(excess) > _HOT_DEVIATIONS * np.sqrt(noise**2 + ROUNDING_VARIANCE)
    share = float(hot.mean())
    if share > _MAX_HOT_SHARE:
        raise CalibrationRejected(
            f"{share:.1%} of the pixels are hot (at most {_MAX_HOT_SHARE:.0%}): either light "
            "enters beside the cover, or the exposure is too long for this camera; cover the lens, "
            "or shorten the exposure"
        )
    # 0.6745 standard deviations of a normal distribution are its median absolute deviation.
    spread = float(np.median(np.abs(excess[~hot] - np.median(excess[~hot])))) / 0.6745
    pattern = np.sqrt(max(0.0, spread**2 - noise**2 / len(frames)))
    dark = Dark(
        offset=float(mean[~hot].mean()),
        noise=noise,
        hot_pixels=np.argwhere(hot).astype(np.int32),
        ambient=None,
        full_scale=float(full_scale),
    )
    return DarkFrames(dark, float(pattern), float((frames == 0).mean()), len(frames))


def with_ambient(dark: Dark, image: npt.NDArray[np.generic], full_scale: float) -> Dark:
    """Add the ambient light, from an image with the lens open and all LEDs off."""
    rows, columns = image.shape
    hot = dark.hot_pixels
    if hot.size and ((hot[:, 0] >= rows) | (hot[:, 1] >= columns)).any():
        raise InputError(
            f"the ambient image has {columns} x {rows} px, but a hot pixel lies outside of it; "
            "give an image of the same camera and size"
        )
    good = np.ones(image.shape, np.bool_)
    good[tuple(hot.T)] = False
    level = float(image[good].mean(dtype=np.float64)) * dark.full_scale / full_scale
    return replace(dark, ambient=level - dark.offset)


def _check_covered(medians: Floats, full_scale: float) -> None:
    level = float(np.median(medians)) / full_scale
    if level > _MAX_OFFSET:
        raise CalibrationRejected(
            f"the frames are not dark: {level:.0%} of full scale; cover the lens with its cap or "
            "with black foil"
        )
    structure = float(np.ptp(medians)) / full_scale
    if structure > _MAX_STRUCTURE:
        raise CalibrationRejected(
            f"the frames are not evenly dark: their parts differ by {structure:.1%} of full scale; "
            "cover the whole lens, and keep light from the back of the camera"
        )


def _check_unlit(frames: Frames, lit: Frames, noise: float, full_scale: float) -> None:
    """Reject frames that the LEDs made brighter."""
    if lit.shape[1:] != frames.shape[1:]:
        raise InputError(f"frames under LEDs have shape {lit.shape}, dark frames {frames.shape}")
    dark = in_blocks(frames).mean(axis=(0, 2), dtype=np.float64)
    rises = in_blocks(lit).mean(axis=2, dtype=np.float64) - dark
    pixels = frames[0].size / BLOCKS**2
    error = np.sqrt((noise**2 + ROUNDING_VARIANCE) / pixels * (1.0 + 1.0 / len(frames)))
    rise = float(rises.max())
    if rise > _SIGNIFICANT_ERRORS * error + _MAX_LEAK_SHARE * full_scale:
        raise CalibrationRejected(
            f"the lens is not covered: an LED makes the frame brighter by up to "
            f"{rise / full_scale:.1%} of full scale; cover the lens with its cap or with black foil"
        )


def _per_pixel(medians: Floats, shape: tuple[int, ...]) -> Floats:
    """(H, W) median of the block of each pixel; margins get the median of the nearest block."""
    block_indices = []
    for size in shape:
        side = size // BLOCKS
        first = (size - side * BLOCKS) // 2
        block_indices.append(np.clip((np.arange(size) - first) // side, 0, BLOCKS - 1))
    rows, columns = block_indices
    grid: Floats = medians.reshape(BLOCKS, BLOCKS)[rows[:, None], columns]
    return grid
