"""`DefectModel`: what good parts of a texture look like, and where a part differs."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from classify.confidence import share_at_most
from classify.errors import DefectModelError
from classify.surface.estimate import SurfaceEstimate

from . import ps4def
from .defect_map import DefectMap
from .departures import DEPARTURES, Departures
from .evidence import QUANTILES, Evidence
from .fields import PartFields, part_fields
from .gaussian import Gaussian
from .octave_statistics import OCTAVE_STATISTICS
from .responses import ALBEDO_RESPONSES, RELIEF_RESPONSES
from .window_statistics import WINDOW_STATISTICS

# Shapes of the arrays of a model by the version of its file; None is any length.
_SHARED_SHAPES: dict[str, tuple[int | None, ...]] = {
    "gains": (2, None, None),
    "relief_limits": (RELIEF_RESPONSES,),
    "albedo_limits": (ALBEDO_RESPONSES,),
    "good_scores": (None,),
}
_SHAPES = {
    1: {
        **_SHARED_SHAPES,
        "statistics_mean": (3 * OCTAVE_STATISTICS,),
        "statistics_whitening": (3 * OCTAVE_STATISTICS,) * 2,
    },
    2: {
        **_SHARED_SHAPES,
        "octaves_mean": (OCTAVE_STATISTICS,),
        "octaves_whitening": (OCTAVE_STATISTICS,) * 2,
        "windows_mean": (WINDOW_STATISTICS,),
        "windows_whitening": (WINDOW_STATISTICS,) * 2,
        "quantiles": (DEPARTURES, QUANTILES),
        "excess": (DEPARTURES,),
        "limit": (1,),
    },
}


@dataclass(frozen=True, eq=False)
class DefectModel:
    """What good parts of one texture look like.

    Attributes
    ----------
    departures
        How far a cell is from good parts.
    evidence
        How improbable that is on good parts, in negative logarithms; None in models of version 1.
    limit
        The limit of the sum of the evidence of a cell.
    false_alarm_rate
        Share of good parts that may exceed 1.0 anywhere, as asked.
    good_scores
        (N,) float64 highest score of each good part by a model of other good parts.
    """

    departures: Departures
    evidence: Evidence | None
    limit: float
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
        return self.map_of_fields(part_fields(surface), orientation_deg)

    def map_of_fields(self, fields: PartFields, orientation_deg: float | None) -> DefectMap:
        """As `map_of`, for a part whose fields are known."""
        departures = self.departures.of(fields, orientation_deg or 0.0)
        departures[:, ~fields.valid] = np.nan
        if self.evidence is None:
            relief, albedo, texture = departures
            return DefectMap(relief, albedo, texture, departures.max(axis=0), fields.shape)
        evidence = self.evidence.of_departures(departures) / np.float32(self.limit)
        relief, albedo, octaves, windows = evidence
        texture = (octaves + windows) / np.float32(2.0)
        return DefectMap(relief, albedo, texture, evidence.sum(axis=0), fields.shape)

    @property
    def parts(self) -> int:
        """Number of good parts."""
        return len(self.good_scores)

    @property
    def false_alarm_bound(self) -> float:
        """Upper bound on the share of good parts with a false alarm, at 95 % confidence.

        It follows from the number of good parts that exceed 1.0 when left out: three parts without
        an alarm show 63 %, 30 parts 10 %, 299 parts 1 %.
        """
        return share_at_most(int(np.count_nonzero(self.good_scores > 1.0)), self.parts)

    @cached_property
    def sha256(self) -> str:
        """Hash of this model, as in its file."""
        return ps4def.digest(self._version, self.false_alarm_rate, self._arrays)

    def save(self, path: str | Path) -> None:
        """Write a ``.ps4def`` file, whole or not at all; raises as `ps4def.write`."""
        ps4def.write(Path(path), self._version, self.false_alarm_rate, self._arrays)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a ``.ps4def`` file; DefectModelError, which names it, if it cannot be used."""
        false_alarm_rate, arrays = ps4def.read(Path(path), _SHAPES)
        gains = arrays["gains"]
        if len(set(gains.shape[1:])) > 1:
            raise DefectModelError(f"{path}: its gains are not square; teach it again")
        octaves, windows, evidence, limit = "statistics", None, None, 1.0
        if "limit" in arrays:
            if min(arrays["limit"].min(), arrays["excess"].min()) <= 0.0:
                raise DefectModelError(
                    f"{path}: its limit or an excess is not above 0; teach it again"
                )
            octaves, limit = "octaves", float(arrays["limit"][0])
            windows = Gaussian(arrays["windows_mean"], arrays["windows_whitening"])
            evidence = Evidence(arrays["quantiles"], arrays["excess"])
        departures = Departures(
            gains, arrays["relief_limits"], arrays["albedo_limits"],
            Gaussian(arrays[f"{octaves}_mean"], arrays[f"{octaves}_whitening"]), windows,
        )  # fmt: skip
        return cls(departures, evidence, limit, false_alarm_rate, arrays["good_scores"])

    @property
    def _version(self) -> int:
        return 1 if self.evidence is None else 2

    @property
    def _arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The arrays of its file."""
        part = self.departures
        arrays: dict[str, npt.NDArray[Any]] = {
            "gains": part.gains,
            "relief_limits": part.relief_limits,
            "albedo_limits": part.albedo_limits,
            "good_scores": self.good_scores,
        }
        gaussians = {"statistics": part.octaves}
        if part.windows is not None and self.evidence is not None:
            gaussians = {"octaves": part.octaves, "windows": part.windows}
            arrays |= {"quantiles": self.evidence.quantiles, "excess": self.evidence.excess}
            arrays["limit"] = np.array([self.limit])
        for name, gaussian in gaussians.items():
            arrays |= {f"{name}_mean": gaussian.mean, f"{name}_whitening": gaussian.whitening}
        return arrays
