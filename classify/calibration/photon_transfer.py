"""The noise of a linear camera by photon transfer: temporal variance against mean.

Shot noise has a variance that is proportional to the light: variance = read^2 + 1/12 +
(mean - black) / gain, with 1/12 from rounding (EMVA 1288, linear camera model). A camera that is
not linear does not obey it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, Floats
from classify.base.errors import CalibrationRejected, InputError
from classify.images import ROUNDING_VARIANCE, SensorNoise

Frames = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

# Blocks along each side. On a 512 px frame the mean of a block has 1/32 of the noise of a pixel.
BLOCKS = 16
# Clipping this share of a block's values changes its mean by 0.003 and its variance by 0.03 of the
# noise (of a normal distribution). It is also the share of hot pixels that `dark_of` accepts.
_MAX_CLIPPED_SHARE = 0.01


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
    clipped = np.maximum(full, black) > _MAX_CLIPPED_SHARE * len(frames) * counts
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
    height, width = rows // BLOCKS, columns // BLOCKS
    top, left = (rows - height * BLOCKS) // 2, (columns - width * BLOCKS) // 2
    inner = frames[:, top : top + height * BLOCKS, left : left + width * BLOCKS]
    grid = inner.reshape(count, BLOCKS, height, BLOCKS, width).swapaxes(2, 3)
    return grid.reshape(count, BLOCKS * BLOCKS, height * width)


@dataclass(frozen=True)
class Noise:
    """Shot and read noise of a camera, in its own pixel values."""

    sensor: SensorNoise
    error: float  # rms error of the fitted variance, as a share of it

    def __post_init__(self) -> None:
        if not 0.0 <= self.error < float("inf"):
            raise InputError(f"the noise has an error of {self.error:g}; give a share of 0 or more")


# Least variance V at which rounding adds 1/12 to within 0.003 at any mean: the first harmonic
# of rounding is exp(-2 pi^2 v) (4 v + 1 / pi^2) with v = V - 1/12. At 0.24, which EMVA 1288
# demands, it is 0.03, and the gain of an 8-bit camera on an even sheet comes out 1 % wrong.
_MIN_VARIANCE, _ROUNDING_ERROR = 0.4, 0.003
# EMVA 1288 fits from the dark to 70 % of saturation: beyond, the brightest pixels clip.
_MAX_FITTED_SHARE = 0.7
# Groups of blocks of similar mean, compared with the line; fewer do not show that it is straight.
_GROUPS, _MIN_GROUPS = 12, 4
# Number of finer parts of similar mean, in which the variances are averaged before a selection.
_SIMILAR_PARTS = 144
# Least span of the levels, as a share of the range; the slope of a short piece is not meaningful.
_MIN_SPAN = 0.2
# rms departure of the groups from the line, as a share of the variance: 0.6 % at most for linear
# cameras, 2.7 % and more for a gamma of 1.15 or 0.85 (test_photon_transfer.py).
_MAX_ERROR = 0.02
_ROUNDS = 5


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """Noise of a camera with the standard errors of its constants."""

    noise: Noise  # its `error` is the rms departure of groups of levels from the line
    gain_error: float  # standard error, as a share
    read_noise_error_dn: float | None  # in pixel values; None if from dark frames


def photon_transfer(
    levels: Sequence[BlockLevels],
    black_level_dn: float,
    full_scale: float,
    dark_noise_dn: float | None = None,
) -> PhotonTransfer:
    """Fit gain and read noise of a linear camera to levels of several exposures of a scene."""
    if not any(level.freedom for level in levels):
        raise CalibrationRejected(
            "the noise is that of two images at one exposure; give two or more of each"
        )
    means = np.concatenate([level.means for level in levels]) - black_level_dn
    variances = np.concatenate([level.variances for level in levels])
    freedom = np.concatenate([np.full(level.means.shape, level.freedom) for level in levels])
    highest = _MAX_FITTED_SHARE * (full_scale - black_level_dn)
    usable = (means <= highest) & (variances >= 0.0)  # false for NaN
    means, variances, freedom = means[usable], variances[usable], freedom[usable]
    dark_variance = None
    if dark_noise_dn is not None and dark_noise_dn**2 >= _MIN_VARIANCE:
        dark_variance = dark_noise_dn**2
    # Blocks are selected by expected variances, because a selection by the noisy ones is biased:
    # first by the mean of similar blocks, then by the line.
    selected = _smoothed(means, variances) >= _MIN_VARIANCE
    for _ in range(2):
        levels_dn = means[selected]
        if len(levels_dn) < _GROUPS or np.ptp(levels_dn) < _MIN_SPAN * highest:
            raise CalibrationRejected(
                f"the noise has a variance of at most {variances.max(initial=0.0):.2g} in pixel "
                f"values, where rounding hides it below {_MIN_VARIANCE:g}, or too few levels are "
                "lit; use a camera format with more bits, or longer exposures"
            )
        line, covariance = _fit(levels_dn, variances[selected], freedom[selected], dark_variance)
        error = _departure(levels_dn, variances[selected], line)
        selected = line[0] + line[1] * means >= _MIN_VARIANCE
    if not (line[1] > 0.0 and error <= _MAX_ERROR):
        raise CalibrationRejected(
            f"the variance departs by {error:.0%} from a line in the mean: the camera is not "
            "linear or reduces noise itself, or the light flickers"
        )
    read_noise = np.sqrt(max(0.0, float(line[0]) - ROUNDING_VARIANCE))
    read_error = None
    if dark_variance is None:
        # Standard error of sqrt(variance): delta method, except near 0.
        variance_error = float(np.hypot(np.sqrt(covariance[0, 0]), _ROUNDING_ERROR))
        read_error = min(variance_error / max(2.0 * read_noise, 1e-12), np.sqrt(variance_error))
    sensor = SensorNoise(float(1.0 / line[1]), float(read_noise), black_level_dn)
    gain_error = float(np.sqrt(covariance[1, 1]) / line[1])
    return PhotonTransfer(Noise(sensor, error), gain_error, read_error)


def _fit(
    means: Floats, variances: Floats, freedom: Floats, intercept: float | None
) -> tuple[Floats, Floats]:
    """Intercept (fitted if None) and slope, with covariance.

    A measured variance V of n degrees of freedom has the variance 2 V^2 / n.
    """
    terms = np.stack([np.ones_like(means), means])
    line: Floats = np.zeros(2)
    expected = np.maximum(variances, _MIN_VARIANCE)
    for _ in range(_ROUNDS):
        weights = freedom / (2.0 * np.square(expected))
        covariance = np.zeros((2, 2))
        if intercept is None:
            covariance[:] = np.linalg.inv(terms * weights @ terms.T)
            line = covariance @ (terms * weights @ variances)
        else:
            covariance[1, 1] = 1.0 / (weights @ np.square(means))
            line = np.array(
                [intercept, covariance[1, 1] * (weights * means @ (variances - intercept))]
            )
        expected = np.maximum(line @ terms, _MIN_VARIANCE)
    # Scatter beyond the noise of the variances, for example by flickering light.
    excess = float(np.mean(np.square(variances - line @ terms) * weights))
    return line, covariance * max(1.0, excess)


def _smoothed(means: Floats, variances: Floats) -> Floats:
    """(n,) mean variance of the blocks of similar mean."""
    order = np.argsort(means)
    parts = np.array_split(order, min(_SIMILAR_PARTS, max(1, len(order))))
    smooth = np.empty_like(variances)
    for part in parts:
        smooth[part] = variances[part].mean() if part.size else 0.0
    return smooth


def _departure(means: Floats, variances: Floats, line: Floats) -> float:
    """Rms over groups of similar mean of the relative departure of their variance."""
    ends = np.linspace(means.min(), means.max(), _GROUPS + 1)[1:-1]
    group = np.searchsorted(ends, means)
    sizes = np.bincount(group, minlength=_GROUPS)
    measured = np.bincount(group, variances, _GROUPS)
    expected = np.bincount(group, line[0] + line[1] * means, _GROUPS)
    filled = sizes > 0
    if np.count_nonzero(filled) < _MIN_GROUPS:
        raise CalibrationRejected(
            f"only {np.count_nonzero(filled)} of {_GROUPS} ranges of levels are lit, too few to "
            "test for a line; use more exposures, or a scene of more levels"
        )
    squares = np.square(measured[filled] / expected[filled] - 1.0)
    return float(np.sqrt(np.average(squares, weights=sizes[filled])))
