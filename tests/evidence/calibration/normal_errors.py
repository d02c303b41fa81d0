"""Angular errors of parts that are solved with more and more of a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from capture.calibration.setting import PartName
from classify import Method
from classify.calibration.calibration import Calibration
from tests.angles import normal_errors_deg

from .rigs import Conditions, Part, capture_part

SURFACES = ("malv", "rock", "weave_dyed")
"""Relief of one scale and of all scales, and relief with a pattern of albedo."""

METHODS: tuple[Method, ...] = ("ps4_robust", "least_squares")
IDEAL = "ideal rig"
STEPS: Mapping[str, tuple[PartName, ...]] = {
    "raw": (),
    "+ dark": ("dark",),
    "+ response": ("dark", "response", "noise"),
    "+ flat field": ("dark", "response", "noise", "flat_field"),
    "+ positions": ("dark", "response", "noise", "flat_field", "lights"),
}
"""Parts of the calibration that are used after each step."""


@dataclass(frozen=True, eq=False)
class StepErrors:
    """Mean angular errors of one rig.

    Attributes
    ----------
    means_deg
        For each method the means over all valid pixels of all surfaces, after each of `STEPS` and
        for `IDEAL`.
    maps_deg
        (H, W) errors of the first surface, solved with the first method.
    """

    conditions: Conditions
    means_deg: Mapping[Method, Mapping[str, float]]
    maps_deg: Mapping[str, npt.NDArray[np.float64]]


def step_errors(
    conditions: Conditions, calibration: Calibration, surfaces: Sequence[str] = SURFACES
) -> StepErrors:
    """Capture surfaces with a rig and with the ideal one, and solve them after each step."""
    parts = [capture_part(conditions.faulty, surface) for surface in surfaces]
    ideal = [capture_part(conditions.ideal, surface) for surface in surfaces]
    used = {
        step: Calibration(**{name: getattr(calibration, name) for name in names})
        for step, names in STEPS.items()
    }
    means: dict[Method, dict[str, float]] = {}
    maps: dict[str, npt.NDArray[np.float64]] = {}
    for method in METHODS:
        solved = {
            step: [_errors(part, method, each) for part in parts] for step, each in used.items()
        }
        solved[IDEAL] = [_errors(part, method, None) for part in ideal]
        means[method] = {
            step: float(np.nanmean(np.concatenate([each.ravel() for each in errors])))
            for step, errors in solved.items()
        }
        maps = maps or {step: errors[0] for step, errors in solved.items()}
    return StepErrors(conditions, means, maps)


def _errors(part: Part, method: Method, calibration: Calibration | None) -> npt.NDArray[np.float64]:
    """Angular errors, NaN where the solver gives no valid slope."""
    surface = part.captured.solve(method, calibration=calibration)
    return np.where(surface.valid, normal_errors_deg(part.truth, surface), np.nan)
