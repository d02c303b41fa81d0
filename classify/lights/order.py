"""The order of four lights, tested by the images of a surface with relief."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from classify.base.arrays import Array, BoolArray, FloatMap, Floats
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.images import Images, ImageStack
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW

from .algebra import drop_one_constants

Order = tuple[int, ...]

_ORDERS: tuple[Order, ...] = tuple(itertools.permutations(range(4)))
_GIVEN_ORDER = _ORDERS[0]
# An order is implausible if its misfit exceeds the best one by this. Images of level surfaces,
# which favour no order, give up to 0.09 (tests/evidence/light_order_rates.py).
_CLEARLY_WORSE = 0.15
# Side of the square in the middle of each level of an image pyramid, and least side of the coarsest
# level. More pixels take more time; tests/evidence/light_order_rates.py prints the share of orders
# that these decide.
_MIDDLE_PX = 192
_COARSEST_PX = 48
# Least number of lit pixels with lit neighbours; a level with fewer is ignored.
_MIN_SAMPLES = 500
_MIN_MISFIT = 1e-9  # avoids log(0)
# Least brightness of a used pixel, as a share of the mean: darker ones are mostly noise.
_MAYBE_NOISE = 0.1
# Largest deviation from 180 degrees of the tilts of two opposite lights.
_OPPOSITE_TOLERANCE_DEG = 30.0


@dataclass(frozen=True)
class _LightOrder:
    """Orders of the lights that four images allow; image k shows light `order[k]`."""

    plausible: tuple[Order, ...]  # best first; all 24 if the images do not decide
    # Rotated by 180 degrees; None unless the lights form two opposite pairs.
    opposite: Order | None
    excess: float  # misfit of the given order above that of the best one; 0 if best

    @property
    def is_refuted(self) -> bool:
        """Whether the lights cannot have been in the given order."""
        return _GIVEN_ORDER not in self.plausible

    @property
    def is_confirmed(self) -> bool:
        """Whether only the given order, or that rotated by 180 degrees, is plausible."""
        return not self.is_refuted and {*self.plausible} <= {_GIVEN_ORDER, self.opposite}


def light_order(
    images: Images,
    lighting: Lighting,
    *,
    ambient: Array | None = None,
    full_scale: float | None = None,
) -> _LightOrder:
    """Test whether linear images (4, H, W) have the order of the lights, up to 180 degrees.

    The misfit of an order is the negative log likelihood, under Laplace errors, of the redundancy
    residual sum_k nul_k i_k and of the curl dp/dy - dq/dx.
    """
    if len(lighting) != 4:
        raise InputError(f"the order of {len(lighting)} lights cannot be tested; give 4")
    stack = ImageStack.checked(images, 4, ambient)
    opposite = _opposite(lighting)
    if opposite is None:
        return _LightOrder(_ORDERS, None, 0.0)
    planes: list[Array] = [*stack.images]
    if stack.ambient is not None:
        planes.append(stack.ambient)
    limit = np.inf if full_scale is None else full_scale
    usable = stack.images.max(axis=0) < limit
    intensities = lighting.intensities.astype(np.float32)[:, None, None]
    pinv, null = drop_one_constants(lighting, "light_order")
    orders = np.array(_ORDERS)
    # (24, 4, 4): x, y and z of the scaled normal and the redundancy residual, from four images.
    weights = np.concatenate([pinv, null[None]])[:, orders].transpose(1, 0, 2).astype(np.float32)
    same_pairs, same_axis = _equivalent_orders(opposite)
    log_residual, log_curl = np.zeros(len(_ORDERS)), np.zeros(len(_ORDERS))
    for middles, usable_middle in _scales(planes, usable):
        values = np.stack(middles[:4]).astype(np.float32, copy=False)
        for ambient_middle in middles[4:]:
            values -= ambient_middle
        log_residuals, log_curls = _misfits(values / intensities, usable_middle, weights)
        # The residual shows only which lights are opposite, the curl shows orders only up to 180
        # degrees: equivalent orders share their smallest misfit.
        log_residual += np.where(same_pairs, log_residuals, np.inf).min(axis=1)
        log_curl += np.where(same_axis, log_curls, np.inf).min(axis=1)
    misfit = log_residual + log_curl
    misfit -= misfit.min()
    ranked = sorted(range(len(_ORDERS)), key=lambda index: float(misfit[index]))
    return _LightOrder(
        plausible=tuple(_ORDERS[index] for index in ranked if misfit[index] < _CLEARLY_WORSE),
        opposite=opposite,
        excess=float(misfit[0]),
    )


def _scales(planes: list[Array], usable: BoolArray) -> Iterator[tuple[list[Array], BoolArray]]:
    """The middle of the frame at full, half, quarter ... resolution."""
    while True:
        rows, columns = usable.shape
        top, left = max(0, (rows - _MIDDLE_PX) // 2), max(0, (columns - _MIDDLE_PX) // 2)
        middle = np.s_[top : rows - top, left : columns - left]
        yield [plane[middle] for plane in planes], usable[middle]
        if min(rows, columns) < 2 * _COARSEST_PX:
            return
        planes = [_mean_half(plane) for plane in planes]
        usable = _halved(usable, np.logical_and)


def _mean_half(plane: Array) -> FloatMap:
    """Means of 2 x 2 pixels; the kernel takes a third of the time of `_halved`."""
    rows, columns = plane.shape
    if rows % 2 or columns % 2:
        return _halved(plane, _mean)
    half = np.empty((rows // 2, columns // 2), np.float32)
    _mean_of_four(plane, half)
    return half


@kernel
def _mean_of_four(plane: Array, half: FloatMap) -> None:
    columns = plane.shape[1]
    share = np.float32(0.5)
    row_means = np.empty(columns, np.float32)
    for r in range(len(half)):
        for c in range(columns):
            row_means[c] = share * (np.float32(plane[2 * r, c]) + np.float32(plane[2 * r + 1, c]))
        for c in range(half.shape[1]):
            half[r, c] = share * (row_means[2 * c] + row_means[2 * c + 1])


def _halved(plane: Array, combine: Callable[[Array, Array], Array]) -> Array:
    """Half of the rows and columns, symmetric about the middle; an odd number combines three."""
    for _ in range(2):
        if len(plane) % 2 == 0:
            plane = combine(plane[::2], plane[1::2])
        else:
            middle = plane[1:-1:2]
            plane = combine(combine(plane[:-2:2], middle), combine(middle, plane[2::2]))
        plane = plane.T
    return plane


def _mean(a: Array, b: Array) -> FloatMap:
    mean: FloatMap = np.add(a, b, dtype=np.float32)
    mean *= np.float32(0.5)
    return mean


def _misfits(values: FloatMap, usable: BoolArray, weights: FloatMap) -> Floats:
    """(2, 24) log of mean residual and mean curl under each order; 0 if too few are lit."""
    brightest = values.max(axis=0)
    lit = usable & (values.min(axis=0) > MAYBE_SHADOW * brightest)
    lit &= brightest > _MAYBE_NOISE * brightest.mean()
    inner = lit[1:-1, 1:-1] & lit[:-2, 1:-1] & lit[2:, 1:-1] & lit[1:-1, :-2] & lit[1:-1, 2:]
    if np.count_nonzero(inner) < _MIN_SAMPLES:
        return np.zeros((2, len(weights)))
    # Shares of the light at a pixel do not depend on its albedo.
    shares = np.where(lit, values, 1.0) / np.where(lit, values.sum(axis=0), 4.0)
    shares = shares.astype(np.float32)
    means = shares.mean(axis=(1, 2), where=lit)
    # One call for all orders, because a thread may wait for the interpreter lock after a call.
    misfits = np.empty((len(weights), 2))
    _misfits_of_orders(shares, means, lit, inner, weights, misfits)
    # A uniform image has neither residual nor curl.
    return np.log(np.maximum(misfits, _MIN_MISFIT)).T


@kernel
def _misfits_of_orders(
    shares: FloatMap, means: FloatMap, lit: BoolArray, inner: BoolArray, weights: FloatMap,
    misfits: Floats,
) -> None:  # fmt: skip
    """Write `_mean_misfits` for each of the `weights` (n, 4, 4) to `misfits` (n, 2)."""
    for order in range(len(weights)):
        residual, curl = _mean_misfits(shares, means, lit, inner, weights[order])
        misfits[order, 0], misfits[order, 1] = residual, curl


@kernel
def _mean_misfits(
    shares: FloatMap, means: FloatMap, lit: BoolArray, inner: BoolArray, weight: FloatMap
) -> tuple[float, float]:
    """Mean absolute deviations of the residual over `lit`, and of the curl over `inner`.

    `shares` (4, H, W) have the means (4,) over lit pixels; `weight` (4, 4) gives the scaled normal
    and the residual.
    """
    rows, columns = lit.shape
    zero, one = np.float32(0.0), np.float32(1.0)
    x0, x1, x2, x3 = weight[0]
    y0, y1, y2, y3 = weight[1]
    z0, z1, z2, z3 = weight[2]
    n0, n1, n2, n3 = weight[3]
    mean_residual = (n0 * means[0] + n1 * means[1]) + (n2 * means[2] + n3 * means[3])
    # Slopes of the last three rows.
    p, q = np.empty((3, columns), np.float32), np.empty((3, columns), np.float32)
    curl = np.empty((rows - 2, columns - 2), np.float32)
    # Sums over the rows of each column, which the compiler vectorises without a change of the order
    # of additions.
    counts, residuals = np.zeros(columns, np.float32), np.zeros(columns, np.float32)
    inner_counts, curls = np.zeros(columns - 2, np.float32), np.zeros(columns - 2, np.float32)
    for row in range(rows):
        above, here, below = (row - 2) % 3, (row - 1) % 3, row % 3
        for column in range(columns):
            a, b = shares[0, row, column], shares[1, row, column]
            c, d = shares[2, row, column], shares[3, row, column]
            over_z = -one / ((z0 * a + z1 * b) + (z2 * c + z3 * d))
            p[below, column] = ((x0 * a + x1 * b) + (x2 * c + x3 * d)) * over_z
            q[below, column] = ((y0 * a + y1 * b) + (y2 * c + y3 * d)) * over_z
            residual = abs((n0 * a + n1 * b) + (n2 * c + n3 * d) - mean_residual)
            counts[column] += one if lit[row, column] else zero
            residuals[column] += residual if lit[row, column] else zero
        if row < 2:
            continue
        for column in range(columns - 2):
            # y is up, rows go down
            dp_dy = p[above, column + 1] - p[below, column + 1]
            pixel_curl = dp_dy - (q[here, column + 2] - q[here, column])
            curl[row - 2, column] = pixel_curl
            inner_counts[column] += one if inner[row - 2, column] else zero
            curls[column] += pixel_curl if inner[row - 2, column] else zero
    count = inner_counts.sum()
    mean_curl = curls.sum() / count
    curls[:] = zero
    for row in range(rows - 2):
        for column in range(columns - 2):
            deviation = abs(curl[row, column] - mean_curl)
            curls[column] += deviation if inner[row, column] else zero
    return residuals.sum() / counts.sum(), curls.sum() / count


def _opposite(lighting: Lighting) -> Order | None:
    """The order with opposite lights exchanged; None if there are not two pairs."""
    try:
        opposite = tuple(
            lighting.light_nearest_tilt(float(tilt) + 180.0, _OPPOSITE_TOLERANCE_DEG)
            for tilt in lighting.tilts_deg
        )
    except InputError:
        return None
    return opposite if opposite in _ORDERS else None


@lru_cache(maxsize=8)
def _equivalent_orders(opposite: Order) -> tuple[BoolArray, BoolArray]:
    """(24, 24) each: whether two orders have the same opposite pairs; whether they are equal.

    Orders that differ by a rotation by 180 degrees count as equal.
    """

    def pairs(order: Order) -> set[frozenset[int]]:
        return {frozenset((image, order.index(opposite[order[image]]))) for image in range(4)}

    def rotations(order: Order) -> set[Order]:
        return {order, tuple(opposite[light] for light in order)}

    return (
        np.array([[pairs(a) == pairs(b) for b in _ORDERS] for a in _ORDERS]),
        np.array([[rotations(a) == rotations(b) for b in _ORDERS] for a in _ORDERS]),
    )
