"""Measurements of a reproduction, and numbers computed from them."""

from dataclasses import dataclass

from classify import Trial
from classify.library.evaluation import nearest_accuracy

from .plan import Plan, Protocol
from .runs import System
from .sand import Polar, SandMaps
from .timing import Cost

SOLVER_TITLES = {
    "ps3a": "PS3a",
    "ps3b": "PS3b",
    "ps3c": "PS3c",
    "ps3d": "PS3d",
    "ps4": "PS4",
    "ps4_robust": "robust PS4",
    "truth": "truth",
}
CLASSIFIER_TITLES = {
    "joint": "joint (ours)",
    "spectra_2d": "2D spectra, magnitude",
    "spectra_2d_power": "2D spectra, power",
    "polar_radial": "1D polar + radial",
    "polar": "1D polar",
    "image_polar": "1D polar of one image",
    "varma_zisserman": "Varma-Zisserman",
}


class Trials(dict[System, list[Trial]]):
    """Trials of all test patches by system."""

    def accuracy_pct(
        self,
        experiment: str,
        test: str,
        solver: str,
        classifier: str,
        protocol: Protocol = "disjoint",
        texture: str | None = None,
    ) -> float | None:
        """Percent of tests whose nearest class is the true one, rejected or not."""
        trials = self.get(System(experiment, test, solver, classifier, protocol), [])
        share = nearest_accuracy([t for t in trials if texture in (None, t.label)])
        return None if share is None else 100.0 * share


@dataclass(frozen=True, eq=False)
class Results:
    """Measurements that the exhibits show.

    `shadow_shares` holds the share of pixels in shadow of a light at each tilt, by texture and
    slant in degrees.
    """

    plan: Plan
    trials: Trials
    shadow_shares: dict[tuple[str, float], tuple[float, ...]]
    polar: dict[float, Polar]  # spectra of sand by orientation in degrees
    maps: SandMaps
    costs: list[Cost]
