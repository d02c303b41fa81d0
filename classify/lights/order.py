"""Which light lit which image: four images of a surface with relief contradict a wrong order."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.images.stack import Images, checked_ambient, checked_stack
from classify.lighting import Lighting

from .algebra import drop_one_constants

__all__ = ["LightOrder", "light_order"]

FloatArray = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]
Order = tuple[int, ...]

_ORDERS: tuple[Order, ...] = tuple(itertools.permutations(range(4)))
_AS_LABELLED = _ORDERS[0]
# An order is given up that explains the images worse than the best one by this much. Images of
# level surfaces, which favour no order, give up to 0.09.
_CLEARLY_WORSE = 0.15
# The middle of the frame is looked at, at every scale at which it has as many pixels as that.
_MIDDLE_PX = 192
_COARSEST_PX = 48
_MIN_SAMPLES = 500
# A light that gives less than this share of the brightest may be in shadow.
_MAYBE_SHADOW = 0.2
# A pixel that has less than this share of the frame's mean brightness shows little but noise.
_MAYBE_NOISE = 0.1
# How far from a half turn two lights may stand and be opposite.
_ACROSS_DEG = 30.0


@dataclass(frozen=True)
class LightOrder:
    """What four images say about the order of their lights.

    An order is a tuple: image k shows light ``order[k]``.

    Attributes
    ----------
    plausible
        The orders that explain the images, best first. All 24 where the images do not tell.
    opposite
        The order with the lights turned by 180 degrees about the camera's axis, which explains
        any images as well: it takes what is raised for indented. None if the lights are not two
        pairs across that axis; then nothing is told.
    excess
        By how much the order as labelled explains the images worse than the best one does: the
        logarithm of the ratio of their contradictions, summed over scales. 0 if it is the best.
    """

    plausible: tuple[Order, ...]
    opposite: Order | None
    excess: float

    @property
    def is_refuted(self) -> bool:
        """Whether the lights cannot have been in the order as labelled."""
        return _AS_LABELLED not in self.plausible

    @property
    def is_confirmed(self) -> bool:
        """Whether the order as labelled, or all of it turned by 180 degrees, is the only one."""
        return not self.is_refuted and {*self.plausible} <= {_AS_LABELLED, self.opposite}


def light_order(
    images: Images,
    lighting: Lighting,
    *,
    ambient: npt.NDArray[Any] | None = None,
    full_scale: float | None = None,
) -> LightOrder:
    """Tell from the images of one surface whether its four lights were in the order of `lighting`.

    Two things hold for a matt surface only if each image is taken for that of its own light. The
    images are linearly dependent: sum_k nul_k i_k = 0, with nul the left null vector of the light
    directions. And the slopes p, q that follow from them are those of a surface: dp/dy = dq/dx.
    Lights exchanged across the ring break the second, lights exchanged with a neighbour the first
    and mostly both. Of an order that makes both left-overs smallest the likelihood is largest, for
    errors of the Laplace distribution and unknown size; that is computed for all 24 orders.

    Only what would hold for a perfect ring decides: the first left-over tells which lights are
    opposite each other, and an order is as likely as itself turned by 180 degrees. What a ring
    that is not perfect makes of them beyond that is less than what it is known to.

    A level surface tells nothing. Slopes along one direction only do not tell orders from each
    other that give the same images. Exchanging both opposite pairs cannot be told from a surface
    that is indented where this one is raised.

    Parameters
    ----------
    images
        (4, H, W) uint8, uint16 or float32, linear in light, in the order of `lighting`.
    lighting
        Four lights. Only of two pairs, each on both sides of the camera's axis, is the order told.
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
        raise InputError(f"the order of {len(lighting)} lights cannot be told; it takes 4")
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
    # (24, 4, 4): x, y and z of the scaled normal and the contradiction, from the four images.
    weights = np.concatenate([pinv, null[None]])[:, orders].transpose(1, 0, 2).astype(np.float32)
    contradiction, curl = np.zeros(len(_ORDERS)), np.zeros(len(_ORDERS))
    for scale in _scales(np.concatenate([values, usable[None]])):
        of_scale = _left_over(scale[:4], scale[4] == 1.0, weights)
        contradiction += _least_of_alike(of_scale[0], [_pairs(o, opposite) for o in _ORDERS])
        curl += _least_of_alike(of_scale[1], [{o, _turned(o, opposite)} for o in _ORDERS])
    misfit = contradiction + curl
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
        yield planes[:, top : top + _MIDDLE_PX, left : left + _MIDDLE_PX]
        if min(rows, columns) < 2 * _COARSEST_PX:
            return
        even = planes[:, : rows // 2 * 2, : columns // 2 * 2]
        across = even[:, :, ::2] + even[:, :, 1::2]
        planes = np.float32(0.25) * (across[:, ::2] + across[:, 1::2])


def _left_over(
    values: FloatArray, usable: BoolArray, weights: FloatArray
) -> npt.NDArray[np.float64]:
    """(2, 24) log of the mean contradiction and of the mean curl under each order.

    All 0 where there are too few pixels under all four lights.
    """
    brightest = values.max(axis=0)
    lit = usable & (values.min(axis=0) > _MAYBE_SHADOW * brightest)
    lit &= brightest > _MAYBE_NOISE * brightest.mean()
    inner = lit[1:-1, 1:-1] & lit[:-2, 1:-1] & lit[2:, 1:-1] & lit[1:-1, :-2] & lit[1:-1, 2:]
    if np.count_nonzero(inner) < _MIN_SAMPLES:
        return np.zeros((2, len(weights)))
    # Shares of the light at a pixel: albedo is out, and what is left of order one.
    shares = np.where(lit, values, 1.0) / np.where(lit, values.sum(axis=0), 4.0)
    flat = shares.reshape(4, -1).astype(np.float32)
    left_over = np.empty((2, len(weights)))
    for index, weight in enumerate(weights):
        b_x, b_y, b_z, contradiction = (weight @ flat).reshape(4, *lit.shape)
        p, q = -b_x / b_z, -b_y / b_z
        curl = (p[:-2, 1:-1] - p[2:, 1:-1]) - (q[1:-1, 2:] - q[1:-1, :-2])  # y is up, rows go down
        left_over[:, index] = np.log(_spread(contradiction[lit])), np.log(_spread(curl[inner]))
    return left_over


def _spread(values: FloatArray) -> float:
    """Mean absolute deviation, never 0. Of the mean, in which LEDs of unlike strength show."""
    return max(float(np.abs(values - values.mean()).mean()), 1e-9)


def _opposite(lighting: Lighting) -> Order | None:
    """The order with each light replaced by the one across the axis, if there are two pairs."""
    try:
        opposite = tuple(
            lighting.light_nearest_tilt(float(tilt) + 180.0, _ACROSS_DEG)
            for tilt in lighting.tilts_deg
        )
    except InputError:
        return None
    return opposite if opposite in _ORDERS else None


def _turned(order: Order, opposite: Order) -> Order:
    return tuple(opposite[light] for light in order)


def _pairs(order: Order, opposite: Order) -> set[frozenset[int]]:
    """Which images are of lights across from each other."""
    return {frozenset((image, order.index(opposite[order[image]]))) for image in range(4)}


def _least_of_alike(
    values: npt.NDArray[np.float64], kinds: Sequence[object]
) -> npt.NDArray[np.float64]:
    """Each value replaced by the least of its kind."""
    return np.array([
        min(value for value, other in zip(values, kinds, strict=True) if other == kind)
        for kind in kinds
    ])  # fmt: skip
