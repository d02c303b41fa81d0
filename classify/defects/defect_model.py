"""`DefectModel`: a model of good parts of a texture, which shows where a part differs."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from classify.base.array_archive import ArchiveKind, arrays_sha256, read_arrays, write_arrays
from classify.base.errors import DefectModelError
from classify.confidence import share_at_most
from classify.surface.estimate import FloatMap, SurfaceEstimate

from .defect_map import DefectMap
from .departures import (
    CENTRES,
    DEPARTURES,
    DEVIATIONS,
    QUANTILES,
    RELIEF,
    STATISTICS,
    TEXTURE,
    DepartureModel,
    EvidenceModel,
    GoodCells,
)
from .fields import PartFields, part_fields
from .filters import ALBEDO, SIZES

SUFFIX = ".ps4def"
_KIND = ArchiveKind(
    noun="defect model",
    header="defects.json",
    version=5,
    if_missing="make one with ps4rig station teach",
    remedy="teach it again",
    error=DefectModelError,
    # A model takes 150 kB, and 8 bytes for each of at most 100 good parts.
    max_bytes=2**22,
    max_header_bytes=2**16,
)


_CHANNEL_WEIGHTS = np.array([1, 10, 30, 3, 10, 10, 10, 10])
CHANNEL_SHARES = _CHANNEL_WEIGHTS / _CHANNEL_WEIGHTS.sum()
"""Shares of the false alarm rate: of the sum of the evidence, and of each departure alone.

Most false alarms of new kinds of places come from the sum and from wide scratches. On the even
textures of `python -m tests.evidence.defects`, with 30 parts taught, these shares gave 2 alarms in
325 good parts. With 10 for fine and 1 for wide scratches there were 3, and 1 % fewer scratches were
found.
"""
_CHANNELS = len(CHANNEL_SHARES)

# Shapes of the arrays of a model; None is any length.
_SHAPES: dict[str, tuple[int | None, ...]] = {
    "gains": (3, None, None),
    "scales": (sum(SIZES),),
    "low_quantiles": (len(DEVIATIONS), QUANTILES),
    "low_excess": (len(DEVIATIONS),),
    "quantiles": (DEPARTURES, QUANTILES),
    "excess": (DEPARTURES,),
    "limits": (_CHANNELS,),
    "good_scores": (None,),
    "false_alarm_rate": (1,),
}
for _name, _columns in STATISTICS.items():
    _count = _columns.stop - _columns.start
    _SHAPES |= {
        f"{_name}_mean": (_count,),
        f"{_name}_whitening": (_count, _count),
        f"{_name}_centres": (CENTRES, _count),
    }
_POSITIVE = ("scales", "low_excess", "excess", "limits", "false_alarm_rate")


@dataclass(frozen=True, eq=False)
class DefectModel:
    """Model of the good parts of one texture.

    Attributes
    ----------
    departures
        How far a cell is from good parts.
    evidence
        How improbable that is on good parts, in negative logarithms.
    limits
        (_CHANNELS,) float32 limits of the evidence of the channels.
    false_alarm_rate
        Requested share of good parts that may exceed 1.0 anywhere.
    good_scores
        (N,) float64 highest score of each good part by a model of other good parts.
    """

    departures: DepartureModel
    evidence: EvidenceModel
    limits: FloatMap
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
        """Score the cells of a part whose fields are computed; see `map_of`."""
        evidence = self.evidence.of(self.departures.of(fields, orientation_deg or 0.0))
        evidence[:, ~fields.valid] = np.nan
        channels = channels_of(evidence) / self.limits[:, None, None]
        total = evidence / self.limits[0]
        alone = channels[1:]
        relief = np.maximum(alone[RELIEF].max(axis=0), total[RELIEF].sum(axis=0))
        albedo = np.maximum(alone[ALBEDO], total[ALBEDO])
        texture = np.maximum(alone[TEXTURE].max(axis=0), total[TEXTURE].sum(axis=0) / 2)
        score = channels.max(axis=0)
        return DefectMap(relief, albedo, texture, score, fields.shape)

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
        return arrays_sha256("", self._arrays)

    def save(self, path: str | Path) -> None:
        """Write a ``.ps4def`` file, whole or not at all."""
        path = Path(path)
        if path.suffix != SUFFIX:
            raise DefectModelError(f"{path}: the name of a defect model must end in {SUFFIX}")
        write_arrays(path, _KIND, self._arrays)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a ``.ps4def`` file; DefectModelError, which names it, if it cannot be used."""
        arrays = read_arrays(Path(path), _KIND, _SHAPES)
        gains = arrays["gains"]
        if gains.shape[1] != gains.shape[2] // 2 + 1:
            raise DefectModelError(f"{path}: its gains are not half a square; teach it again")
        for name in _POSITIVE:
            if arrays[name].min() <= 0.0:
                raise DefectModelError(f"{path}: its {name} are not above 0; teach it again")
        cells = tuple(
            GoodCells(*(arrays[f"{name}_{part}"] for part in ("mean", "whitening", "centres")))
            for name in STATISTICS
        )
        missing_texture = EvidenceModel(arrays["low_quantiles"], arrays["low_excess"])
        return cls(
            DepartureModel(gains, arrays["scales"], cells, missing_texture),
            EvidenceModel(arrays["quantiles"], arrays["excess"]),
            arrays["limits"],
            float(arrays["false_alarm_rate"][0]),
            arrays["good_scores"],
        )

    @property
    def _arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The arrays of its file."""
        departures = self.departures
        arrays: dict[str, npt.NDArray[Any]] = {
            "gains": departures.gains,
            "scales": departures.scales,
            "low_quantiles": departures.missing_texture.quantiles,
            "low_excess": departures.missing_texture.excess,
            "quantiles": self.evidence.quantiles,
            "excess": self.evidence.excess,
            "limits": self.limits,
            "good_scores": self.good_scores,
            "false_alarm_rate": np.array([self.false_alarm_rate]),
        }
        for name, cells in zip(STATISTICS, departures.cells, strict=True):
            arrays |= {f"{name}_{field}": value for field, value in vars(cells).items()}
        return arrays


def channels_of(evidence: FloatMap) -> FloatMap:
    """(_CHANNELS, h, w) evidence of the channels, from that of the departures."""
    return np.concatenate([evidence.sum(axis=0, keepdims=True), evidence])
