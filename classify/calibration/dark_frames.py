"""The dark part of a calibration, from frames with the lens covered."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats
from classify.base.errors import CalibrationRejected, InputError
from classify.images.noise import ROUNDING_VARIANCE

from .block_levels import BLOCKS, Frames, in_blocks, temporal_variances
from .dark import Dark

# Deviation of a hot pixel from its block, in standard deviations of one frame (with rounding). A
# smaller deviation disturbs an image less than noise does; the mean of 16 frames of normal noise
# never reaches it.
_HOT = 6.0
# Good industrial sensors have fewer than one hot pixel in a thousand.
_MOST_HOT = 0.01
# Shares of full scale. An 8-bit camera of gamma 2.2 with an offset of 1/64 shows 15 % in the dark;
# a lens that is open in a lit room shows more, or a scene. The glow of a sensor's electronics
# stays below 1 % of full scale at exposures of up to a second.
_MOST_OFFSET, _MOST_STRUCTURE = 0.25, 0.02
# Share of full scale by which a light may raise a block: less than the least signal of an LED.
_LEAK = 0.002
# Standard errors of a difference that is not noise: any of 256 blocks exceeds them by chance in one
# of four million sets.
_SIGNIFICANT = 6.0
# With a larger share of values at 0, offset and noise are those of a clipped distribution: 0.1 % of
# normal noise lies more than 3.1 standard deviations below its mean.
_CLIPPED = 0.001


@dataclass(frozen=True, eq=False)
class DarkFrames:
    """A dark part and further measures of its frames."""

    dark: Dark
    fixed_pattern: float  # standard deviation of the pixels' offsets, in pixel values
    clipped: float  # share of the values at 0
    frames: int  # number of frames

    @property
    def is_clipped(self) -> bool:
        """Whether so many values are 0 that offset and noise are not those of the sensor."""
        return self.clipped > _CLIPPED


def dark_of(frames: Frames, full_scale: float, lit: Frames | None = None) -> DarkFrames:
    """Measure offset, noise and hot pixels from (F, H, W) frames with the lens covered."""
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
    hot = np.abs(excess) > _HOT * np.sqrt(noise**2 + ROUNDING_VARIANCE)
    share = float(hot.mean())
    if share > _MOST_HOT:
        raise CalibrationRejected(
            f"{share:.1%} of the pixels are hot (at most {_MOST_HOT:.0%}): either light comes in "
            "beside the cover, or the exposure is too long for this camera; cover the lens, or "
            "shorten the exposure"
        )
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
    """Return `dark` with the ambient light of an image with the lens open and all LEDs off."""
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
    if level > _MOST_OFFSET:
        raise CalibrationRejected(
            f"the frames are not dark: {level:.0%} of full scale; cover the lens with its cap or "
            "with black foil"
        )
    structure = float(np.ptp(medians)) / full_scale
    if structure > _MOST_STRUCTURE:
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
    if rise > _SIGNIFICANT * error + _LEAK * full_scale:
        raise CalibrationRejected(
            f"the lens is not covered: an LED makes the frame brighter by up to "
            f"{rise / full_scale:.1%} of full scale; cover the lens with its cap or with black foil"
        )


def _per_pixel(medians: Floats, shape: tuple[int, ...]) -> Floats:
    """(H, W) median of the block of each pixel; margins get that of the nearest block."""
    places = []
    for size in shape:
        side = size // BLOCKS
        first = (size - side * BLOCKS) // 2
        places.append(np.clip((np.arange(size) - first) // side, 0, BLOCKS - 1))
    grid: Floats = medians.reshape(BLOCKS, BLOCKS)[places[0][:, None], places[1]]
    return grid
