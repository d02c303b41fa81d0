"""The answer of a library: which class, how far turned, how sure, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify.classifiers import Comparison
from classify.texture.heading import LEAST_SCORE

__all__ = ["Match", "match_of"]


@dataclass(frozen=True)
class Match:
    """Which texture a surface shows, or that it shows none of them.

    Attributes
    ----------
    label
        The class, or None: unknown.
    nearest
        The nearest class, even then.
    orientation_deg
        Orientation of the surface, anticlockwise, modulo 180, in the terms of the training set;
        None where the classifier knows no angles.
    heading_deg
        The same over the full turn, [0, 360), where the texture is another one upside down and it
        is clear which way it lies; else None.
    distance
        Distance to the nearest class. For the joint classifier 1 is the typical distance between
        two quarters of one training frame.
    runner_up, runner_up_distance
        The next other class; None in a library of one class.
    margin
        1 - distance / runner_up_distance: 0 undecided, 1 beyond doubt; None without a runner-up.
    limit
        Distance beyond which a surface is not of the nearest class; None where none was learned.
    sharpness
        How clear the orientation is: 0 any angle does as well, 1 one angle explains everything
        directional. None as for the orientation.
    reason
        Why the label is what it is, in words.
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


def match_of(
    found: Comparison,
    labels: Sequence[str],
    orientations_deg: npt.NDArray[np.float64],
    limits: Mapping[str, float],
) -> Match:
    """The match of a surface from its comparison with n references.

    Parameters
    ----------
    found
        With each of n references.
    labels, orientations_deg
        Of these references.
    limits
        Of the classes; empty if none were learned.
    """
    best_of_class: dict[str, int] = {}
    for index in np.argsort(found.distances, kind="stable").tolist():
        best_of_class.setdefault(labels[index], index)
        if len(best_of_class) == 2:
            break
    ranked = list(best_of_class.items())
    nearest, winner = ranked[0]
    distance = float(found.distances[winner])
    runner_up, second = ranked[1] if len(ranked) > 1 else (None, None)
    runner_up_distance = None if second is None else float(found.distances[second])
    margin = None
    if runner_up_distance is not None:
        margin = 1.0 - distance / runner_up_distance if runner_up_distance > 0.0 else 0.0
    limit = limits.get(nearest)
    label: str | None = nearest
    if margin == 0.0:
        # To name one of two at the same distance would be to toss a coin.
        label, reason = None, f"{nearest} and {runner_up} are equally near"
    elif limit is not None and distance > limit:
        label = None
        reason = f"nearest is {nearest}, but {distance:.2f} away; its limit is {limit:.2f}"
    else:
        within = "" if limit is None else f" of at most {limit:.2f}"
        reason = f"{nearest} is {distance:.2f}{within} away"
        if runner_up is not None:
            reason += f", next is {runner_up} at {runner_up_distance:.2f}"
    orientation_deg = heading_deg = sharpness = None
    if found.orientations_deg is not None:
        turned_deg = float(orientations_deg[winner] + found.orientations_deg[winner])
        # Rounded first: a hair below 0 is 0, not a hair below 180.
        orientation_deg = round(turned_deg, 6) % 180.0
        heading = 0.0 if found.headings is None else float(found.headings[winner])
        if abs(heading) >= LEAST_SCORE:
            heading_deg = round(turned_deg + 180.0 * (heading < 0.0), 6) % 360.0
    if found.sharpness is not None:
        sharpness = float(found.sharpness[winner])
    return Match(
        label=label,
        nearest=nearest,
        orientation_deg=orientation_deg,
        distance=distance,
        runner_up=runner_up,
        runner_up_distance=runner_up_distance,
        margin=margin,
        limit=limit,
        sharpness=sharpness,
        reason=reason,
        heading_deg=heading_deg,
    )
