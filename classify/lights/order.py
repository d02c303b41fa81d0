"""The order of four lights, tested by the images of a surface with relief."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.compiling import kernel
from classify.errors import InputError
from classify.images.stack import Images, checked_ambient, checked_stack
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW
from classify.threads import map_in_threads

from .algebra import drop_one_constants

FloatArray = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]
Order = tuple[int, ...]

_ORDERS: tuple[Order, ...] = tuple(itertools.permutations(range(4)))
_GIVEN = _ORDERS[0]
# An order whose misfit is larger than the best by this is implausible. Images of level surfaces,
# which favour no order, give up to 0.09 (tests/rig/test_light_order_rates.py).
_CLEARLY_WORSE = 0.15
# The middle of the frame is used, at every scale at which its sides have at least the coarsest
# number of pixels. More pixels take more time; tests/rig/test_light_order_rates.py holds the share
# of orders that these decide.
_MIDDLE_PX = 192
_COARSEST_PX = 48
_MIN_SAMPLES = 500
_LEAST_MISFIT = 1e-9  # the logarithm of 0 is avoided
# A pixel with less than this share of the frame's mean brightness is mostly noise.
_MAYBE_NOISE = 0.1
# Largest deviation from 180 degrees of the tilts of two opposite lights.
_ACROSS_DEG = 30.0


@dataclass(frozen=True)
class LightOrder:
    """Orders of the lights that four images allow.

    An order is a tuple: image k shows light ``order[k]``.

    Attributes
    ----------
    plausible
        The orders that explain the images, best first. All 24 if the images do not decide.
    opposite
        The order with the lights rotated by 180 degrees about the camera's axis. It explains any
        images as well, with raised and indented exchanged. None if the lights are not two pairs
        across that axis; then nothing is decided.
    excess
        Misfit of the given order above that of the best one: the logarithm of the ratio of their
        residuals, summed over scales. 0 if it is the best.
    """

    plausible: tuple[Order, ...]
    opposite: Order | None
    excess: float

    @property
    def is_refuted(self) -> bool:
        """Whether the lights cannot have been in the given order."""
        return _GIVEN not in self.plausible

    @property
    def is_confirmed(self) -> bool:
        """Whether only the given order, or that rotated by 180 degrees, is plausible."""
        return not self.is_refuted and {*self.plausible} <= {_GIVEN, self.opposite}


def light_order(
    images: Images,
    lighting: Lighting,
    *,
    ambient: npt.NDArray[Any] | None = None,
    full_scale: float | None = None,
) -> LightOrder:
    """Test by the images of one surface whether its four lights were in the order of `lighting`.

    Two conditions hold for a matt surface only if each image is assigned to its own light. The
    redundancy residual sum_k nul_k i_k is zero, with nul the left null vector of the light
    directions. And the slopes p, q are those of a surface: their curl dp/dy - dq/dx is zero. Lights
    exchanged across the ring break the second condition, lights exchanged with a neighbour the
    first and mostly both. The misfit of an order is the sum of the logarithms of its mean absolute
    residual and curl: minus its log likelihood for errors of a Laplace distribution of unknown
    width. It is computed for all 24 orders.

    Only what would hold for a perfect ring is used: the residual decides which lights are opposite
    each other, and an order has the same misfit as itself rotated by 180 degrees. Differences
    beyond that come from errors of the light positions as well.

    A level surface decides nothing. Slopes along one direction only cannot distinguish orders that
    give the same images. Both opposite pairs exchanged give the same images as a surface that is
    indented where this one is raised.

    Parameters
    ----------
    images
        (4, H, W) uint8, uint16 or float32, linear in light, in the order of `lighting`.
    lighting
        Four lights. The order is tested only if they are two pairs across the camera's axis.
    ambient
        (H, W) image with all lights out, of the same dtype, subtracted from each image.
    full_scale
        Pixel value at which the sensor saturates; pixels that reach it do not count.

    Raises
    ------
    InputError
        For another number of lights, or images that are not theirs.
    """
    if len(lighting) != 4:
        raise InputError(f"the order of {len(lighting)} lights cannot be tested; give 4")
    stack = checked_stack(images, 4)
    opposite = _opposite(lighting)
    if opposite is None:
        return LightOrder(_ORDERS, None, 0.0)
    values = stack.astype(np.float32)
    usable = np.ones(stack.shape[1:], np.float32)
    if full_scale is not None:
        usable[stack.max(axis=0) >= full_scale] = 0.0
    if ambient is not None:
        values -= checked_ambient(ambient, stack)
    values /= lighting.intensities.astype(np.float32)[:, None, None]
    pinv, null = drop_one_constants(lighting, "light_order")
    orders = np.array(_ORDERS)
    # (24, 4, 4): x, y and z of the scaled normal and the redundancy residual, from four images.
    weights = np.concatenate([pinv, null[None]])[:, orders].transpose(1, 0, 2).astype(np.float32)
    residual, curl = np.zeros(len(_ORDERS)), np.zeros(len(_ORDERS))
    for scale in _scales(np.concatenate([values, usable[None]])):
        residuals, curls = _misfits(scale[:4], scale[4] == 1.0, weights)
        residual += _least_of_kind(residuals, [_pairs(o, opposite) for o in _ORDERS])
        curl += _least_of_kind(curls, [{o, _rotated(o, opposite)} for o in _ORDERS])
    misfit = residual + curl
    misfit -= misfit.min()
    ranked = sorted(range(len(_ORDERS)), key=lambda index: float(misfit[index]))
    return LightOrder(
        plausible=tuple(_ORDERS[index] for index in ranked if misfit[index] < _CLEARLY_WORSE),
        opposite=opposite,
        excess=float(misfit[0]),
    )


def _scales(planes: FloatArray) -> Iterator[FloatArray]:
    """The middle of the frame at full, half, quarter ... resolution."""
    while True:
        rows, columns = planes.shape[1:]
        top, left = max(0, (rows - _MIDDLE_PX) // 2), max(0, (columns - _MIDDLE_PX) // 2)
        yield planes[:, top : rows - top, left : columns - left]
        if min(rows, columns) < 2 * _COARSEST_PX:
            return
        planes = _halved(_halved(planes).swapaxes(1, 2)).swapaxes(1, 2)


def _halved(planes: FloatArray) -> FloatArray:
    """Half as many rows, symmetric about the middle: means of two, of three where they are odd."""
    if planes.shape[1] % 2 == 0:
        return np.float32(0.5) * (planes[:, ::2] + planes[:, 1::2])
    middle = planes[:, 1:-1:2]
    return np.float32(0.25) * ((planes[:, :-2:2] + middle) + (middle + planes[:, 2::2]))


def _misfits(values: FloatArray, usable: BoolArray, weights: FloatArray) -> npt.NDArray[np.float64]:
    """(2, 24) log of the mean residual and of the mean curl under each order.

    All 0 if too few pixels are lit by all four lights.
    """
    brightest = values.max(axis=0)
    lit = usable & (values.min(axis=0) > MAYBE_SHADOW * brightest)
    lit &= brightest > _MAYBE_NOISE * brightest.mean()
    inner = lit[1:-1, 1:-1] & lit[:-2, 1:-1] & lit[2:, 1:-1] & lit[1:-1, :-2] & lit[1:-1, 2:]
    if np.count_nonzero(inner) < _MIN_SAMPLES:
        return np.zeros((2, len(weights)))
    # Shares of the light at a pixel do not depend on its albedo.
    shares = np.where(lit, values, 1.0) / np.where(lit, values.sum(axis=0), 4.0)
    shares = shares.astype(np.float32)

    def of_order(weight: FloatArray) -> tuple[float, float]:
        residual, curl = _mean_misfits(shares, lit, inner, weight)
        return residual, curl

    # An even image has neither residual nor curl.
    return np.log(np.maximum(map_in_threads(of_order, [*weights]), _LEAST_MISFIT)).T


@kernel
def _mean_misfits(
    shares: FloatArray, lit: BoolArray, inner: BoolArray, weight: FloatArray
) -> tuple[float, float]:
    """Mean absolute deviations of residual and curl from their means, over `lit` and `inner`.

    Unequal LED levels change the means only. `shares` is (4, H, W), `inner` (H - 2, W - 2), and
    `weight` (4, 4) gives the scaled normal and the residual from four shares.
    """
    rows, columns = lit.shape
    p, q = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.float32)
    residual = np.empty((rows, columns), np.float32)
    curl = np.empty((rows - 2, columns - 2), np.float32)
    for row in range(rows):
        for column in range(columns):
            a, b = shares[0, row, column], shares[1, row, column]
            c, d = shares[2, row, column], shares[3, row, column]
            over_z = -1.0 / (
                weight[2, 0] * a + weight[2, 1] * b + weight[2, 2] * c + weight[2, 3] * d
            )
            x = weight[0, 0] * a + weight[0, 1] * b + weight[0, 2] * c + weight[0, 3] * d
            y = weight[1, 0] * a + weight[1, 1] * b + weight[1, 2] * c + weight[1, 3] * d
            p[row, column], q[row, column] = x * over_z, y * over_z
            residual[row, column] = (
                weight[3, 0] * a + weight[3, 1] * b + weight[3, 2] * c + weight[3, 3] * d
            )
    for row in range(rows - 2):
        for column in range(columns - 2):
            # y is up, rows go down
            across = p[row, column + 1] - p[row + 2, column + 1]
            curl[row, column] = across - (q[row + 1, column + 2] - q[row + 1, column])
    return _spread(residual, lit), _spread(curl, inner)


@kernel
def _spread(values: FloatArray, chosen: BoolArray) -> float:
    """Mean absolute deviation from the mean of the chosen values."""
    count, total = 0, 0.0
    for row in range(values.shape[0]):
        for column in range(values.shape[1]):
            if chosen[row, column]:
                count += 1
                total += values[row, column]
    mean, deviation = total / count, 0.0
    for row in range(values.shape[0]):
        for column in range(values.shape[1]):
            if chosen[row, column]:
                deviation += abs(values[row, column] - mean)
    return deviation / count


def _opposite(lighting: Lighting) -> Order | None:
    """The order with each light replaced by that across the axis; None without two pairs."""
    try:
        opposite = tuple(
            lighting.light_nearest_tilt(float(tilt) + 180.0, _ACROSS_DEG)
            for tilt in lighting.tilts_deg
        )
    except InputError:
        return None
    return opposite if opposite in _ORDERS else None


def _rotated(order: Order, opposite: Order) -> Order:
    return tuple(opposite[light] for light in order)


def _pairs(order: Order, opposite: Order) -> set[frozenset[int]]:
    """Pairs of images whose lights are opposite each other."""
    return {frozenset((image, order.index(opposite[order[image]]))) for image in range(4)}


def _least_of_kind(
    values: npt.NDArray[np.float64], kinds: Sequence[object]
) -> npt.NDArray[np.float64]:
    """Replace each value by the smallest of its kind."""
    return np.array([
        min(value for value, other in zip(values, kinds, strict=True) if other == kind)
        for kind in kinds
    ])  # fmt: skip
