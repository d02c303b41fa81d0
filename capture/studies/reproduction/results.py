"""All that was measured, before any of it is shown."""

from __future__ import annotations

from dataclasses import dataclass

from .exams import Rejection
from .gallery import Polar, SandMaps
from .plan import Plan
from .tally import Tally
from .timing import Cost

__all__ = ["CLASSIFIER_TITLES", "SOLVER_TITLES", "Results"]

SOLVER_TITLES = {
    "ps3a": "PS3a",
    "ps3b": "PS3b",
    "ps3c": "PS3c",
    "ps3d": "PS3d",
    "ps4": "PS4",
    "ps4_robust": "robust PS4",
    "truth": "truth",
}
"""As figures call the solvers."""

CLASSIFIER_TITLES = {
    "joint": "joint (ours)",
    "spectra_2d": "2D spectra, magnitude",
    "spectra_2d_power": "2D spectra, power",
    "polar_radial": "1D polar + radial",
    "polar": "1D polar",
    "image_polar": "1D polar of one image",
    "varma_zisserman": "Varma-Zisserman",
}
"""As figures call the classifiers."""


@dataclass(frozen=True, eq=False)
class Results:
    """What the exhibits are made of.

    Attributes
    ----------
    shadow_shares
        By texture and slant, degrees: share in shadow under a light at each of the tilts.
    polar
        By orientation, degrees: polar spectra of sand.
    """

    plan: Plan
    tally: Tally
    rejections: list[Rejection]
    shadow_shares: dict[tuple[str, float], tuple[float, ...]]
    polar: dict[float, Polar]
    maps: SandMaps
    costs: list[Cost]
