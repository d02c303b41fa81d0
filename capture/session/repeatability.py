"""Repeated sets of one placement: how far their slopes differ, beside what their noise states."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from classify import SurfaceEstimate
from classify.images import SIGMA_PER_MAD

from .journal import SetEntry


@dataclass(frozen=True)
class Repeatability:
    """Deviation of a slope between two repeats of a placement."""

    specimen: str
    orientation_deg: float
    measured: float  # robust deviation of the difference of p, q over the square root of two
    stated: float  # median standard deviation of p, q


def first_repeats(entries: Iterable[SetEntry]) -> list[tuple[SetEntry, SetEntry]]:
    """The first two sets of each placement that has two."""

    def place(entry: SetEntry) -> tuple[str, float]:
        return entry.specimen, entry.orientation_deg

    groups = [list(sets) for _, sets in groupby(sorted(entries, key=place), key=place)]
    return [(sets[0], sets[1]) for sets in groups if len(sets) > 1]


def repeatability_of(
    entry: SetEntry, first: SurfaceEstimate, second: SurfaceEstimate
) -> Repeatability | None:
    """Compare two surfaces with deviations; None without a pixel that is valid in both."""
    valid = first.valid & second.valid
    if first.shape != second.shape or not valid.any():
        return None
    planes = ((first.p, second.p, first.p_sd), (first.q, second.q, first.q_sd))
    differences, deviations = [], []
    for one, other, deviation in planes:
        assert deviation is not None
        differences.append(np.abs(one - other)[valid])
        deviations.append(deviation[valid])
    spread = SIGMA_PER_MAD * float(np.median(np.concatenate(differences))) / np.sqrt(2.0)
    stated = float(np.median(np.concatenate(deviations)))
    return Repeatability(entry.specimen, entry.orientation_deg, float(spread), stated)
