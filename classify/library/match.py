"""`Match`: the class of a surface, its orientation and the reason, and the references compared."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats, Indices
from classify.classifiers import Comparison
from classify.texture.blur import MAX_BLURRIER_PX, MAX_SHARPER_PX
from classify.texture.heading import MIN_SCORE
from classify.texture.uniformity import Uniformity, uniformity_remarks

# A smaller blur is not mentioned in the reason: sets in equal focus differ by 0.0 to 0.3 px.
_MIN_REPORTED_PX = 0.3
# Least margin of a known surface, for classifiers with limits. classify/DECISIONS.md has how often
# the nearest class is wrong below and above it.
MIN_MARGIN = 0.15
# An estimate of blur within this of its lower or upper bound counts as at the bound.
_ROUNDING_PX = 1e-3


@dataclass(frozen=True)
class Match:
    """The texture of a surface, or that it is unknown.

    Attributes
    ----------
    label
        The class; None for an unknown surface.
    nearest
        The nearest class, also of an unknown surface.
    orientation_deg
        Orientation of the surface, anticlockwise, [0, 180), with the zero of the training sets.
        None where the classifier finds no orientation.
    heading_deg
        The orientation over 360 degrees, [0, 360), where the texture looks clearly different when
        rotated by 180 degrees; else None.
    distance
        Distance to the nearest class. For the joint classifier 1 is the typical distance between
        two quarters of one training frame.
    runner_up, runner_up_distance
        The next other class; None in a library of one class.
    margin
        1 - distance / runner_up_distance: 0 undecided, 1 certain; None without a runner-up. Below
        0.15 a surface is unknown where limits were learned.
    limit
        Distance beyond which the nearest class rejects; None where none was learned.
    sharpness
        How well the orientation is determined: 0 not at all, 1 exactly. None without orientation.
    reason
        The reason for the label, as text.
    blur_px
        Sigma of the Gaussian by which the surface is blurrier than the nearest training set;
        negative where it is sharper. None where the classifier finds no blur.
    class_uniformity
        Whether the nearest class is uniform, varied or no texture; None where it is not known.
    """

    label: str | None
    nearest: str
    orientation_deg: float | None
    distance: float
    runner_up: str | None
    runner_up_distance: float | None
    margin: float | None
    limit: float | None = None
    sharpness: float | None = None
    reason: str = ""
    heading_deg: float | None = None
    blur_px: float | None = None
    class_uniformity: Uniformity | None = None


def match_of(
    comparison: Comparison,
    labels: Sequence[str],
    orientations_deg: Floats,
    limits: Mapping[str, float],
    uniformity: Mapping[str, Uniformity],
    *,
    blurred_px: float = 0.0,
) -> Match:
    """Make a match from the comparison of a surface, blurred by `blurred_px`, with n references."""
    best_of_class: dict[str, int] = {}
    for index in np.argsort(comparison.distances, kind="stable").tolist():
        best_of_class.setdefault(labels[index], index)
        if len(best_of_class) == 2:
            break
    ranked = list(best_of_class.items())
    nearest, winner = ranked[0]
    distance = float(comparison.distances[winner])
    runner_up, second = ranked[1] if len(ranked) > 1 else (None, None)
    runner_up_distance = None if second is None else float(comparison.distances[second])
    margin = None
    if runner_up_distance is not None:
        margin = 1.0 - distance / runner_up_distance if runner_up_distance > 0.0 else 0.0
    compared_px = 0.0 if comparison.blurs_px is None else float(comparison.blurs_px[winner])
    orientation_deg, heading_deg = _orientation(comparison, winner, float(orientations_deg[winner]))
    match = Match(
        label=nearest,
        nearest=nearest,
        orientation_deg=orientation_deg,
        distance=distance,
        runner_up=runner_up,
        runner_up_distance=runner_up_distance,
        margin=margin,
        limit=limits.get(nearest),
        sharpness=None if comparison.sharpness is None else float(comparison.sharpness[winner]),
        heading_deg=heading_deg,
        blur_px=None if comparison.blurs_px is None else _blur_without(blurred_px, compared_px),
        class_uniformity=uniformity.get(nearest),
    )
    is_comparable = _ROUNDING_PX - MAX_SHARPER_PX < compared_px < MAX_BLURRIER_PX - _ROUNDING_PX
    is_known, reason = _verdict(match, is_comparable=is_comparable)
    return replace(match, label=nearest if is_known else None, reason=reason)


def _orientation(
    comparison: Comparison, winner: int, reference_deg: float
) -> tuple[float | None, float | None]:
    """Orientation and heading by the nearest reference, whose orientation is `reference_deg`."""
    if comparison.orientations_deg is None:
        return None, None
    sum_deg = reference_deg + float(comparison.orientations_deg[winner])
    heading_deg, scores = None, comparison.heading_scores
    if scores is not None and abs(scores[winner]) >= MIN_SCORE:
        heading_deg = round(sum_deg + 180.0 * (scores[winner] < 0.0), 6) % 360.0
    # Rounded first: -1e-12 is 0, not 180 - 1e-12.
    return round(sum_deg, 6) % 180.0, heading_deg


def _verdict(match: Match, *, is_comparable: bool) -> tuple[bool, str]:
    """Whether the surface is known, and the reason; one too far out of focus is not comparable."""
    blur_px = match.blur_px or 0.0
    focus = f"{abs(blur_px):.1f} px {'blurrier' if blur_px > 0.0 else 'sharper'}"
    if match.margin == 0.0:
        return False, f"{match.nearest} and {match.runner_up} are equally near"
    if not is_comparable:
        return False, f"out of focus: {focus} than {match.nearest} or more, too much to compare"
    is_known = True
    reason = f"distance {match.distance:.2f} to {match.nearest}"
    if match.limit is not None:
        is_known = match.distance <= match.limit
        reason += ", limit" if is_known else " exceeds its limit"
        reason += f" {match.limit:.2f}"
    if abs(blur_px) >= _MIN_REPORTED_PX:
        reason += f", {focus}"
    if match.runner_up is not None:
        reason += f"; next is {match.runner_up} at {match.runner_up_distance:.2f}"
    is_close = match.margin is not None and match.margin < MIN_MARGIN
    if is_known and is_close and match.limit is not None:
        is_known = False
        reason += ", too close to decide"
    if is_known and match.class_uniformity == "no texture":
        reason += f"; {uniformity_remarks({match.nearest: match.class_uniformity})[0]}"
    return is_known, reason


def _blur_without(blurred_px: float, compared_px: float) -> float:
    """Blur of a surface before a Gaussian of `blurred_px` made it `compared_px`."""
    variance_px2 = compared_px * abs(compared_px) - blurred_px**2
    return math.copysign(math.sqrt(abs(variance_px2)), variance_px2)


# Number of references compared first: those of the lowest bounds, and as many of other classes.
FIRST_COUNT = 64
# Largest number of references compared after that, to limit the time. Of 100,000 references the
# nearest is among them in 99.9 % of queries (``tests.evidence.benchmark``).
MAX_CANDIDATES = 4096


def nearest_references(
    classes: npt.NDArray[np.integer], bounds: Floats, compare: Callable[[Indices], Comparison]
) -> tuple[Indices, Comparison]:
    """Compare all references that may be the nearest or runner-up; their indices are ascending."""
    # The lowest bounds are compared first. Let d1 be the smallest distance, to class c, and d2 the
    # smallest to another class. Then references of c with a bound of at most d1, and others with a
    # bound of at most d2, are compared too. NaN, which a mapped file may contain, becomes bound 0.
    bounds = np.fmax(bounds, 0.0)
    lowest = _lowest(bounds, FIRST_COUNT)
    other_classes = np.flatnonzero(classes != classes[lowest[0]])
    first = np.union1d(lowest, other_classes[_lowest(bounds[other_classes], FIRST_COUNT)])
    comparison = compare(first)
    best = int(np.argmin(comparison.distances))
    is_other_class = classes != classes[first[best]]
    second_best = comparison.distances[is_other_class[first]].min(initial=np.inf)
    may_be_nearer = bounds <= np.where(is_other_class, second_best, comparison.distances[best])
    may_be_nearer[first] = False
    candidates = np.flatnonzero(may_be_nearer)
    candidates = candidates[_lowest(bounds[candidates], MAX_CANDIDATES)]
    if not len(candidates):
        return first, comparison
    indices = np.concatenate([first, candidates])
    order = np.argsort(indices)
    return indices[order], _joined(comparison, compare(candidates), order)


def _lowest(values: Floats, count: int) -> Indices:
    """Indices of the `count` lowest values, in any order; of all if there are fewer."""
    if len(values) <= count:
        return np.arange(len(values))
    return np.argpartition(values, count)[:count]


def _joined(first: Comparison, second: Comparison, order: Indices) -> Comparison:
    def joined(one: Floats | None, other: Floats | None) -> Floats | None:
        return None if one is None or other is None else np.concatenate([one, other])[order]

    return Comparison(
        np.concatenate([first.distances, second.distances])[order],
        joined(first.orientations_deg, second.orientations_deg),
        joined(first.sharpness, second.sharpness),
        joined(first.heading_scores, second.heading_scores),
        joined(first.blurs_px, second.blurs_px),
    )
