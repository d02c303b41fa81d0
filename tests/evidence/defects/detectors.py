"""The detectors of the study: learned from good parts, they score the cells of a part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from classify.defects.learning import learn_defects
from classify.surface.estimate import FloatMap

from . import learned
from .comparators import GaussianDetector, albedo_filters, one_photograph
from .parts import Part

Score = Callable[[Part, float], FloatMap]
"""Scores (h, w) of the cells of a part at an orientation in degrees; 1.0 is the limit."""

Learn = Callable[[Sequence[Part], Sequence[float], float], Score]
"""Learn from good parts, their orientations in degrees, and the rate of false alarms."""

OURS = "defect map"


def _defect_map(
    parts: Sequence[Part], orientations_deg: Sequence[float], false_alarm_rate: float
) -> Score:
    surfaces = (part.surface for part in parts)
    model = learn_defects(surfaces, orientations_deg, false_alarm_rate)
    return lambda part, angle: model.map_of(part.surface, angle).score


def _gaussian(features: Callable[[Part, float], FloatMap]) -> Learn:
    def learn(parts: Sequence[Part], angles: Sequence[float], rate: float) -> Score:
        return GaussianDetector.learn(features, parts, angles, rate).score

    return learn


DETECTORS: Mapping[str, Learn] = {
    OURS: _defect_map,
    "one photograph": _gaussian(one_photograph),
    "albedo, PaDiM-like": _gaussian(albedo_filters),
    **(
        {"PaDiM, EfficientNet": _gaussian(learned.network_features)} if learned.IS_INSTALLED else {}
    ),
}
