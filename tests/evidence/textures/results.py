"""Measurements of the study of textures, and numbers computed from them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from capture.chapter.plan import OURS
from capture.chapter.results import Trials
from capture.chapter.runs import System

from .open_set import Outcome
from .plan import TexturePlan

DIRECTIONAL_SHARPNESS = 0.5
"""Below it, the orientation of a joint match may be off by 90 degrees (see classifiers/joint)."""


@dataclass(frozen=True, eq=False)
class TextureResults:
    """Measurements that the exhibits show."""

    plan: TexturePlan
    outcomes: dict[System, list[Outcome]]

    @cached_property
    def trials(self) -> Trials:
        """The matches with the class of the patch in the library."""
        return Trials(
            (system, [outcome.trial for outcome in outcomes])
            for system, outcomes in self.outcomes.items()
        )

    def orientation_errors_deg(self, system: System) -> npt.NDArray[np.float64]:
        """Errors of correct matches on patches in which our classifier sees a direction."""
        trials = self.trials
        ours = trials[system._replace(classifier=OURS)]
        return np.array([
            error_deg
            for reference, trial in zip(ours, trials[system], strict=True)
            if reference.nearest_is_correct
            and (reference.match.sharpness or 0.0) > DIRECTIONAL_SHARPNESS
            and (error_deg := trial.nearest_orientation_error_deg) is not None
        ])  # fmt: skip
