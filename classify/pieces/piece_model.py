"""`PieceModel`: windows, spots and the whole of good parts of one texture."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from classify.base.array_archive import ArchiveKind, arrays_sha256, read_arrays, write_arrays
from classify.base.arrays import Floats
from classify.base.errors import PieceModelError
from classify.surface.estimate import FloatMap

from .features import (
    DIRECTIONS,
    FEATURES,
    MOMENTS,
    OCTAVES,
    PRODUCTS,
    coarser,
    energy_columns,
    window_features,
    window_moments,
)
from .look_alikes import LookAlikes
from .spots import DEPARTURES, SPOT_VALUES, SpotModel, spot_values

_Complex = npt.NDArray[np.complex128]

# Shrinkage of the covariance towards its diagonal: at least this, and more for few parts, whose
# correlations are mostly chance.
_MIN_SHRINKAGE = 0.2
_MIN_VARIANCE = 1e-10


@dataclass(frozen=True, eq=False)
class _LinearMeasure:
    """Position of features along a direction: (features - origin) @ weights.

    It is 0 at the origin and 1 at origin + direction.
    """

    origin: Floats  # (d,)
    weights: Floats  # (d,)

    @classmethod
    def of(cls, good: Floats, direction: Floats, origin: Floats | None = None) -> Self:
        """Measure of a direction with the least variance on (n, d) good parts (Fisher 1936).

        The origin is by default their mean.
        """
        mean = good.mean(axis=0)
        deviations = good - mean
        covariance = deviations.T @ deviations / (len(good) - 1)
        variances = np.diag(np.diag(covariance) + _MIN_VARIANCE)
        shrinkage = _MIN_SHRINKAGE + (1.0 - _MIN_SHRINKAGE) / (len(good) - 1)
        shrunk = (1.0 - shrinkage) * covariance + shrinkage * variances
        weights = np.linalg.solve(shrunk, direction)
        response = float(direction @ weights)
        if response > 0.0:
            weights /= response
        return cls(mean if origin is None else origin, weights)

    def of_part(self, features: Floats) -> float:
        """Measure of a part with (d,) features."""
        return float((features - self.origin) @ self.weights)


def scale_measure(good: Floats, direction: Floats) -> tuple[_LinearMeasure, Floats]:
    """Measure of the logarithm of the scale, along its `direction`.

    Returns the measure, and the leave-one-out value of each good part.
    """
    left_out = [
        _LinearMeasure.of(np.delete(good, n, axis=0), direction).of_part(part)
        for n, part in enumerate(good)
    ]
    return _LinearMeasure.of(good, direction), np.array(left_out)


def handedness_measure(good: Floats) -> tuple[_LinearMeasure, Floats]:
    """Measure of handedness, 1 for good parts and -1 for mirrored ones, like `scale_measure`."""

    def measure(parts: Floats) -> _LinearMeasure:
        return _LinearMeasure.of(parts, parts.mean(axis=0), np.zeros(parts.shape[1]))

    left_out = [measure(np.delete(good, n, axis=0)).of_part(part) for n, part in enumerate(good)]
    return measure(good), np.array(left_out)


def octave_levels(moments: FloatMap) -> Floats:
    """Logarithms of the root mean square of slopes, then of log albedo, in each octave."""
    energies = moments.mean(axis=(0, 1), dtype=np.float64)[energy_columns()]
    return np.asarray(0.5 * np.log(np.maximum(energies, 1e-9)))


def pseudo_scalars(moments: FloatMap) -> Floats:
    """Imaginary parts of conj(u) v, with u and v of two octaves, or of relief and albedo.

    Rotations keep them, because u and v have the same spin, the multiple of the rotation by which
    their angles change; a mirror changes their sign.
    """
    squares, fourths, albedos = [], [], []
    for octave in range(OCTAVES):
        energy, c2, s2, c4, s4, albedo, pa, qa = np.moveaxis(
            moments[..., 2 + PRODUCTS * octave :][..., :PRODUCTS].astype(np.float64), -1, 0
        )
        unit = max(float(energy.mean()), 1e-12)
        squares.append((c2 + 1j * s2) / unit)
        fourths.append((c4 + 1j * s4) / unit)
        albedos.append((pa + 1j * qa) / np.sqrt(unit * max(float(albedo.mean()), 1e-12)))
    return np.array([*_imaginary_products(squares, fourths, albedos)])


def _imaginary_products(
    squares: list[_Complex], fourths: list[_Complex], albedos: list[_Complex]
) -> Iterator[float]:
    """Imaginary parts of conj(u) v of all pairs of fields with spin 1, 2 or 4."""
    means = [
        [np.asarray(field.mean()) for field in fields] for fields in (squares, fourths, albedos)
    ]
    for spin_2, spin_4, spin_1 in ((squares, fourths, albedos), means):
        for fields in (
            spin_1,
            [*spin_2, *(field**2 for field in spin_1)],
            [*spin_4, *(field**2 for field in spin_2)],
        ):
            for u, v in combinations(fields, 2):
                yield float((u.conj() * v).imag.mean())


SUFFIX = ".ps4piece"
_KIND = ArchiveKind(
    noun="piece model",
    header="pieces.json",
    version=6,
    if_missing="make one with ps4rig station teach",
    remedy="teach it again",
    error=PieceModelError,
    # Centres: two views of 1,000 windows with 28 float32 each, and two with 16, take 0.4 MB.
    max_bytes=2**22,
    max_header_bytes=2**16,
)


VIEWS: tuple[tuple[str, int, tuple[int, ...]], ...] = (
    ("window_64", 4, tuple(range(FEATURES))),
    ("window_128", 8, tuple(range(FEATURES))),
    ("seam_64", 4, DIRECTIONS),
    ("seam_128", 8, DIRECTIONS),
)
"""Name, side in blocks of 2 x 2 cells, and compared features of every view of a part.

`python -m tests.evidence.wrong_passes` counts the faults that they find. The features of a window
scatter too much to show small faults; spots show these.
"""
SIZES = tuple(dict.fromkeys(size for _, size, _ in VIEWS))


@dataclass(frozen=True, eq=False)
class PieceMeasures:
    """How far a part is from good parts, in pieces and as a whole.

    Scores are in units of their limits.
    """

    window_map: FloatMap  # (h, w) scores of the cells, by spots and windows
    seam_map: FloatMap  # (h, w) scores by the directions of the windows around a cell
    octaves: float  # score of the power in an octave of relief or albedo, the largest
    scale: float  # size of the texture, 1 as taught
    handedness: float | None  # 1 as taught, -1 mirrored; None if mirror images look alike

    @property
    def window(self) -> float:
        """The largest score of a window."""
        return float(self.window_map.max())

    @property
    def seam(self) -> float:
        """The largest score of the directions of a window."""
        return float(self.seam_map.max())


@dataclass(frozen=True, eq=False)
class PieceModel:
    """Model of the windows, the spots and the whole of good parts of one texture."""

    floors: FloatMap  # (MOMENTS,) added to the energies
    views: dict[str, LookAlikes]  # by the name of the view; scores in units of its limit
    spots: SpotModel
    octave_means: Floats  # levels of good parts in each octave of relief and of albedo
    octave_limits: Floats  # largest departures from `octave_means`
    scale: _LinearMeasure  # of the logarithm of the scale
    handedness: _LinearMeasure | None  # None if mirror images look alike
    has_direction: bool  # whether windows rotated by 90 degrees look unlike all good ones
    scale_deviation: float  # standard deviation of the leave-one-out log scales of good parts

    def measure(
        self, moments: FloatMap, orientation_deg: float | None, rings: Floats
    ) -> PieceMeasures:
        """Measure a part by its `band_moments` and the `ring_means` of its library."""
        orientation_deg = orientation_deg or 0.0
        spots = self.spots.cell_scores(spot_values(moments, self.floors, orientation_deg))
        coarse = coarser(moments)
        maps = {kind: np.zeros(coarse.shape[:2], np.float32) for kind in ("window", "seam")}
        windows = {size: window_moments(coarse, size) for size in SIZES}
        features = {
            size: window_features(windows[size], self.floors, orientation_deg) for size in SIZES
        }
        for name, size, _ in VIEWS:
            scores = np.sqrt(self.views[name].scores(features[size]))
            _raise_cells(
                maps[name.partition("_")[0]], scores.reshape(windows[size].shape[:2]), size
            )
        window_map, seam_map = (
            scores.repeat(2, axis=0).repeat(2, axis=1) for scores in maps.values()
        )
        departures = np.abs(octave_levels(coarse) - self.octave_means) / self.octave_limits
        handedness = self.handedness
        return PieceMeasures(
            np.maximum(window_map, spots),
            seam_map,
            float(departures.max()),
            float(np.exp(self.scale.of_part(rings))),
            None if handedness is None else handedness.of_part(pseudo_scalars(coarse)),
        )

    @cached_property
    def sha256(self) -> str:
        """Hash of this model, as in its file."""
        return arrays_sha256("", self._arrays)

    def save(self, path: str | Path) -> None:
        """Write a ``.ps4piece`` file, whole or not at all."""
        write_arrays(Path(path), _KIND, self._arrays)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a ``.ps4piece`` file; PieceModelError, which names it, if it cannot be used."""
        arrays = read_arrays(Path(path), _KIND, _shapes())
        views = {
            name: LookAlikes(*(arrays[f"{name}_{part}"] for part in _LOOK_ALIKE_ARRAYS))
            for name, _, _ in VIEWS
        }
        handedness = arrays["handedness_weights"]
        return cls(
            arrays["floors"],
            views,
            SpotModel(arrays["spot_weights"], arrays["spot_offsets"]),
            arrays["octave_means"],
            arrays["octave_limits"],
            _LinearMeasure(arrays["scale_origin"], arrays["scale_weights"]),
            _LinearMeasure(np.zeros(len(handedness)), handedness) if len(handedness) else None,
            bool(arrays["has_direction"][0]),
            float(arrays["scale_deviation"][0]),
        )

    @property
    def _arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The arrays of its file."""
        arrays: dict[str, npt.NDArray[Any]] = {
            "floors": self.floors,
            "spot_weights": self.spots.weights,
            "spot_offsets": self.spots.offsets,
            "octave_means": self.octave_means,
            "octave_limits": self.octave_limits,
            "scale_origin": self.scale.origin,
            "scale_weights": self.scale.weights,
            "has_direction": np.array([float(self.has_direction)]),
            "scale_deviation": np.array([self.scale_deviation]),
            "handedness_weights": np.zeros(0)
            if self.handedness is None
            else self.handedness.weights,
        }
        for name, view in self.views.items():
            arrays |= {f"{name}_{part}": getattr(view, part) for part in _LOOK_ALIKE_ARRAYS}
        return arrays


_LOOK_ALIKE_ARRAYS = ("whitening", "centres", "spreads")


def _shapes() -> dict[str, tuple[int | None, ...]]:
    """Shapes of the arrays of a model; None is any length."""
    shapes: dict[str, tuple[int | None, ...]] = {
        "floors": (MOMENTS,),
        "spot_weights": (SPOT_VALUES, 2 * len(DEPARTURES)),
        "spot_offsets": (2 * len(DEPARTURES),),
        "octave_means": (None,),
        "octave_limits": (None,),
        "scale_origin": (None,),
        "scale_weights": (None,),
        "has_direction": (1,),
        "scale_deviation": (1,),
        "handedness_weights": (None,),
    }
    for name, _, columns in VIEWS:
        shapes[f"{name}_whitening"] = (FEATURES, len(columns))
        shapes[f"{name}_centres"] = (None, len(columns))
        shapes[f"{name}_spreads"] = (None,)
    return shapes


def _raise_cells(cells: FloatMap, scores: FloatMap, size: int) -> None:
    """Raise each cell to the largest score of the windows that contain it."""
    half = max(size // 2, 1)
    blocks = np.kron(scores, np.ones((half, half), np.float32))
    rows, columns = blocks.shape
    for top in range(0, size, half):
        for left in range(0, size, half):
            covered = cells[top : top + rows, left : left + columns]
            np.maximum(covered, blocks[: covered.shape[0], : covered.shape[1]], out=covered)
