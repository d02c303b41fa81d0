"""Means and temporal variances of blocks of a frame, from repeated frames."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, Floats
from classify.base.errors import InputError

Frames = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

# Blocks along each side. On a 512 px frame the mean of a block has 1/32 of the noise of a pixel.
BLOCKS = 16
# Clipping this share of a block's values changes its mean by 0.003 and its variance by 0.03 of the
# noise (of a normal distribution). It is also the share of hot pixels that `dark_of` accepts.
_CLIPPED = 0.01


@dataclass(frozen=True, eq=False)
class BlockLevels:
    """Blocks of a scene at one exposure, in pixel values of the camera."""

    means: Floats  # (n,); NaN where more than 1 % of the values are clipped
    variances: Floats  # (n,) temporal variance of a pixel in one frame; NaN likewise
    saturated: float  # share of all values at full scale
    freedom: float  # degrees of freedom of each variance


def block_levels(
    frames: Frames, full_scale: float, hot_pixels: npt.NDArray[np.int32] | None = None
) -> BlockLevels:
    """Return the levels of 16 x 16 blocks of (F, H, W) frames of one still scene."""
    blocks: Frames = in_blocks(frames)
    usable = np.ones(frames.shape[1:], np.bool_)
    if hot_pixels is not None:
        usable[tuple(hot_pixels.T)] = False
    counted = in_blocks(usable[None])[0]
    means, variances, freedom = temporal_variances(blocks, counted)
    counts = counted.sum(axis=1)
    full = ((blocks >= full_scale) & counted).sum(axis=(0, 2))
    black = ((blocks == 0) & counted).sum(axis=(0, 2))
    clipped = np.maximum(full, black) > _CLIPPED * len(frames) * counts
    means[clipped] = variances[clipped] = np.nan
    saturated = float(full.sum()) / (len(frames) * float(counts.sum()))
    return BlockLevels(means, variances, saturated, freedom)


def temporal_variances(blocks: Frames, counted: BoolArray) -> tuple[Floats, Floats, float]:
    """(n,) means and variances of `counted` values (F, n, pixels), and their freedom."""
    counts = np.maximum(counted.sum(axis=1), 1)
    means, squares = np.empty(len(counts)), np.empty(len(counts))
    # A few blocks at a time: as float32, all frames of a large camera would not fit into memory.
    for part in np.array_split(np.arange(len(counts)), BLOCKS):
        values = blocks[:, part].astype(np.float32)
        values *= counted[part]
        frame_means = values.sum(axis=2, dtype=np.float64) / counts[part]
        values -= (frame_means[:, :, None] * counted[part]).astype(np.float32)
        values -= values.mean(axis=0)
        means[part] = frame_means.mean(axis=0)
        squares[part] = np.square(values).sum(axis=(0, 2), dtype=np.float64)
    freedom = (len(blocks) - 1) * (counts - 1)
    variances = np.where(freedom > 0, squares / np.maximum(freedom, 1), np.nan)
    return means, variances, float(np.median(freedom))


def in_blocks(frames: Array) -> Array:
    """(F, blocks, pixels) values of (F, H, W) frames, without incomplete blocks."""
    if frames.ndim != 3:
        raise InputError(f"frames have shape {frames.shape}; give (frames, rows, columns)")
    if min(frames.shape[1:]) < 2 * BLOCKS:
        raise InputError(
            f"frames of {frames.shape[2]} x {frames.shape[1]} px; give {2 * BLOCKS} px or more a "
            "side, for blocks that show the noise"
        )
    count, rows, columns = frames.shape
    tall, wide = rows // BLOCKS, columns // BLOCKS
    top, left = (rows - tall * BLOCKS) // 2, (columns - wide * BLOCKS) // 2
    inner = frames[:, top : top + tall * BLOCKS, left : left + wide * BLOCKS]
    grid = inner.reshape(count, BLOCKS, tall, BLOCKS, wide).swapaxes(2, 3)
    return grid.reshape(count, BLOCKS * BLOCKS, tall * wide)
