"""Measurements of a reproduction, and numbers computed from them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from classify import Trial
from classify.library.evaluation import nearest_accuracy, nearest_orientation_errors_deg

from .plan import OURS, Plan, Protocol
from .runs import Outcome, System
from .sand import Polar, SandMaps
from .timing import Cost

DIRECTIONAL_SHARPNESS = 0.5
"""Below it, the orientation of a joint match may be off by 90 degrees (see classifiers/joint)."""

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


@dataclass(frozen=True, eq=False)
class Results:
    """Measurements that the exhibits show.

    `shadow_shares` holds the share of pixels in shadow of a light at each tilt, by texture and
    slant in degrees.
    """

    plan: Plan
    outcomes: dict[System, list[Outcome]]
    shadow_shares: dict[tuple[str, float], tuple[float, ...]]
    polar: dict[float, Polar]  # spectra of sand by orientation in degrees
    maps: SandMaps
    costs: list[Cost]

    def trials(self, system: System, texture: str | None = None) -> list[Trial]:
        """Trials of a system on all textures or on one; empty if it was not tested."""
        outcomes = self.outcomes.get(system, [])
        return [each.trial for each in outcomes if texture in (None, each.trial.label)]

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
        system = System(experiment, test, solver, classifier, protocol)
        return percent(nearest_accuracy(self.trials(system, texture)))

    def orientation_errors_deg(self, system: System) -> npt.NDArray[np.float64]:
        """Errors of correct matches on patches in which our classifier sees a direction."""
        ours = self.trials(system._replace(classifier=OURS))
        return np.array(
            nearest_orientation_errors_deg(
                trial
                for reference, trial in zip(ours, self.trials(system), strict=True)
                if reference.nearest_is_correct
                and (reference.match.sharpness or 0.0) > DIRECTIONAL_SHARPNESS
            )
        )


class Answers(NamedTuple):
    """Percent of tests on known textures: right, refused, wrong; unknown accepted."""

    right: float
    refused: float
    wrong: float
    accepted: float


def answers_pct(outcomes: Sequence[Outcome]) -> Answers:
    """Count the answers by the limits in the library, with and without the class of the test."""
    labels = [(each.trial.label, each.trial.match.label) for each in outcomes]
    unknown = [match for each in outcomes if (match := each.match_without_class)]
    return Answers(
        right=_share_pct(found == true for true, found in labels),
        refused=_share_pct(found is None for _, found in labels),
        wrong=_share_pct(found not in (true, None) for true, found in labels),
        accepted=_share_pct(match.label is not None for match in unknown),
    )


def percent(share: float | None) -> float | None:
    """A share in percent; None stays None."""
    return None if share is None else 100.0 * share


def _share_pct(answers: Iterable[bool]) -> float:
    return 100.0 * float(np.mean(list(answers)))
