"""`DefectModel`: what good parts of one texture look like, and where another part differs."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, reduce
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from scipy.stats import beta

from classify.errors import DefectModelError
from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.threads import map_in_threads

from . import ps4def
from .defect_map import DefectMap
from .fields import PartFields, part_fields
from .local_statistics import STATISTICS
from .observation import Observation
from .responses import ALBEDO_RESPONSES, RELIEF_RESPONSES

_CONFIDENCE = 0.95
# Shapes of the arrays of a model; None is any length.
_SHAPES = {
    "gains": (2, None, None),
    "relief_limits": (RELIEF_RESPONSES,),
    "albedo_limits": (ALBEDO_RESPONSES,),
    "statistics_mean": (STATISTICS,),
    "statistics_whitening": (STATISTICS, STATISTICS),
    "good_scores": (None,),
}


@dataclass(frozen=True, eq=False)
class DefectModel:
    """Spectra, local statistics and limits of the good parts of one texture.

    Attributes
    ----------
    gains
        (2, n, n) float32 whitening gains of relief and albedo in the frame of the texture.
    relief_limits, albedo_limits
        (RELIEF_RESPONSES,) and (ALBEDO_RESPONSES,) float32 limits of spots and lines.
    statistics_mean, statistics_whitening
        (d,) and (d, d) float32: the Mahalanobis distance of the statistics s of a cell, in units of
        its limit, is the length of (s - mean) @ whitening.
    false_alarm_rate
        Share of good parts that may exceed 1.0 anywhere, as asked.
    good_scores
        (N,) float64 highest score of each good part, when it was left out of the model.
    """

    gains: FloatMap
    relief_limits: FloatMap
    albedo_limits: FloatMap
    statistics_mean: FloatMap
    statistics_whitening: FloatMap
    false_alarm_rate: float
    good_scores: npt.NDArray[np.float64]

    def map_of(self, surface: SurfaceEstimate, orientation_deg: float | None) -> DefectMap:
        """Score the cells of a part.

        Parameters
        ----------
        surface
            The part, of the same size of pixel on the part as the good parts.
        orientation_deg
            Orientation of its texture, as of `Match.orientation_deg`; None for a texture without
            orientation.

        Raises
        ------
        InputError
            If no pixel is valid.
        """
        fields = part_fields(surface)
        relief, albedo, texture = self._scores(fields, orientation_deg or 0.0)
        return DefectMap(relief, albedo, texture, surface.shape)

    @property
    def parts(self) -> int:
        """Number of good parts."""
        return len(self.good_scores)

    @property
    def false_alarm_bound(self) -> float:
        """Upper bound of the false alarms per part that these parts show, at 95 % confidence.

        Of Clopper and Pearson, from how many of the good parts exceed 1.0 when left out: three
        parts without an alarm show 63 %, 30 parts 10 %, 299 parts 1 %.
        """
        alarms = int(np.count_nonzero(self.good_scores > 1.0))
        if alarms == self.parts:
            return 1.0
        return float(beta.ppf(_CONFIDENCE, alarms + 1, self.parts - alarms))

    @cached_property
    def sha256(self) -> str:
        """Hash of this model, as in its file."""
        return ps4def.digest(self.false_alarm_rate, self._arrays)

    def save(self, path: str | Path) -> None:
        """Write a ``.ps4def`` file, whole or not at all; raises as `ps4def.write`."""
        ps4def.write(Path(path), self.false_alarm_rate, self._arrays)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a ``.ps4def`` file; DefectModelError, which names it, if it cannot be used."""
        false_alarm_rate, arrays = ps4def.read(Path(path), _SHAPES)
        if len(set(arrays["gains"].shape[1:])) > 1:
            raise DefectModelError(f"{path}: its gains are not square; teach it again")
        return cls(**arrays, false_alarm_rate=false_alarm_rate)

    @property
    def _arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {name: getattr(self, name) for name in _SHAPES}

    def _scores(self, fields: PartFields, orientation_deg: float) -> list[FloatMap]:
        observation = Observation.of(fields, self.gains, orientation_deg)

        def texture() -> FloatMap:
            offset = (observation.statistics() - self.statistics_mean) @ self.statistics_whitening
            distance: FloatMap = np.sqrt(np.einsum("hwd,hwd->hw", offset, offset))
            return distance

        kinds: list[Callable[[], FloatMap]] = [
            lambda: _highest(observation.relief_responses(), self.relief_limits),
            lambda: _highest(observation.albedo_responses(), self.albedo_limits),
            texture,
        ]
        # Most arrays are too small to be shared out among threads themselves.
        scores = map_in_threads(lambda kind: kind(), kinds)
        return [np.where(fields.valid, score, np.float32(np.nan)) for score in scores]


def _highest(responses: Iterator[FloatMap], limits: FloatMap) -> FloatMap:
    """The highest response of every cell in units of its limit."""
    scores = (response / limit for response, limit in zip(responses, limits, strict=True))
    return reduce(np.maximum, scores)
