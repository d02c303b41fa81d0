"""What differs between the maps of two sides, pixel by pixel."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class FieldDifference:
    """A field and its value on either side; None where one does not have it."""

    field: str
    first: Any
    second: Any


def field_differences(
    first: Mapping[str, Any], second: Mapping[str, Any], name: str = ""
) -> Iterator[FieldDifference]:
    """Yield the fields that differ, as paths with dots; lists are compared as a whole."""
    for key in dict.fromkeys([*first, *second]):
        one, other = first.get(key), second.get(key)
        path = f"{name}.{key}" if name else key
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            yield from field_differences(one, other, path)
        elif one != other:
            yield FieldDifference(path, one, other)


@dataclass(frozen=True)
class MapDifference:
    """The second map less the first, over the pixels that are valid in both."""

    unit: str  # of all figures but the correlation; empty for slopes
    mean: float
    rms: float
    p95: float  # 95th percentile of the magnitudes
    largest: float  # magnitude
    correlation: float  # of the two maps: near 1 for a part that lies as before; 0 if constant


def map_difference(
    first: npt.NDArray[np.floating[Any]],
    second: npt.NDArray[np.floating[Any]],
    valid: npt.NDArray[np.bool_],
    unit: str,
) -> MapDifference | None:
    """Compare two (H, W) maps pixel by pixel; None if no pixel is valid or finite in both."""
    used = valid & np.isfinite(first) & np.isfinite(second)
    if not used.any():
        return None
    one, other = first[used].astype(np.float64), second[used].astype(np.float64)
    off = other - one
    magnitudes = np.abs(off)
    return MapDifference(
        unit=unit,
        mean=float(off.mean()),
        rms=float(np.sqrt(np.mean(off**2))),
        p95=float(np.percentile(magnitudes, 95)),
        largest=float(magnitudes.max()),
        correlation=_correlation(one, other),
    )


def normal_angles_deg(
    first: Sequence[npt.NDArray[np.floating[Any]]], second: Sequence[npt.NDArray[np.floating[Any]]]
) -> npt.NDArray[np.float64]:
    """(H, W) angle between the normals of two surfaces, each given by its slopes p and q."""
    (p1, q1), (p2, q2) = (
        [np.asarray(slope, np.float64) for slope in slopes] for slopes in (first, second)
    )
    # |n1 x n2| and n1 . n2 of (-p, -q, 1): exact also for small angles.
    cross = np.sqrt((p1 - p2) ** 2 + (q1 - q2) ** 2 + (p1 * q2 - p2 * q1) ** 2)
    angles: npt.NDArray[np.float64] = np.degrees(np.arctan2(cross, p1 * p2 + q1 * q2 + 1.0))
    return angles


def _correlation(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> float:
    one, other = one - one.mean(), other - other.mean()
    energy = float(np.sqrt((one**2).sum() * (other**2).sum()))
    return float((one * other).sum() / energy) if energy > 0.0 else 0.0
