"""One pick of four photographs, solved and judged by the other photographs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from classify import Method, SurfaceEstimate, photometric_stereo

from .photograph_set import PhotographSet, Pick

METHODS: tuple[Method, ...] = ("ps4", "ps4_robust", "least_squares")
_DARK = 0.05  # of the 99th percentile: darker pixels of a photograph are in shadow
_FEWEST_PX = 100
_CHANGED = 0.01  # difference of slopes that counts as a change


@dataclass(frozen=True)
class Score:
    """Errors of one method on one pick, in percent.

    Attributes
    ----------
    median_pct, mean_pct
        Error of the photographs of the lights that were not used, predicted from slopes and albedo
        with one gain for each light, relative to their mean: median over pixels, and mean with
        each error cut at 100 %. Means over these photographs; None without any, or for a planar
        part.
    valid_pct
        Share of the object that is valid.
    changed_pct
        Share of the object whose slopes differ by more than 0.01 when photographs and lights are
        rotated by 90 degrees together, or mirrored; the larger of both.
    reference_r
        Correlation of p with that of the reference over the valid object.
    """

    name: str
    lights: int
    pick: Pick
    method: Method
    planar: bool
    median_pct: float | None
    mean_pct: float | None
    valid_pct: float
    changed_pct: float
    reference_r: float | None


def solve_pick(
    photographs: PhotographSet, pick: Pick, method: Method, planar: bool = False
) -> SurfaceEstimate:
    """Solve four of the photographs."""
    return photometric_stereo(
        photographs.images[list(pick)],
        photographs.lighting_of(pick),
        method,
        ambient=photographs.ambient,
        full_scale=photographs.full_scale,
        planar=planar,
    )


def scores_of(photographs: PhotographSet) -> Iterator[Score]:
    """Score every method on every pick; where there is a reference, also as a planar part."""
    as_planar = (False, True) if photographs.reference_p is not None else (False,)
    for pick in photographs.picks():
        for planar in as_planar:
            for method in METHODS:
                yield _score(photographs, pick, method, planar)


def _score(photographs: PhotographSet, pick: Pick, method: Method, planar: bool) -> Score:
    mask, surface = photographs.mask, solve_pick(photographs, pick, method, planar)
    errors = None if planar else _held_out_errors(photographs, pick, surface)
    seen = mask & surface.valid
    reference = photographs.reference_p
    return Score(
        photographs.name,
        len(photographs.directions),
        pick,
        method,
        planar,
        None if errors is None else 100.0 * errors[0],
        None if errors is None else 100.0 * errors[1],
        100.0 * float(surface.valid[mask].mean()),
        100.0 * _changed_share(photographs, pick, method, planar, surface),
        None if reference is None else float(np.corrcoef(surface.p[seen], reference[seen])[0, 1]),
    )


def _held_out_errors(
    photographs: PhotographSet, pick: Pick, surface: SurfaceEstimate
) -> tuple[float, float] | None:
    """Median and mean relative error over the object of the photographs that were not used."""
    mask, normals = photographs.mask, surface.normals
    ambient = 0.0 if photographs.ambient is None else photographs.ambient.astype(np.float32)
    medians, means = [], []
    for light, direction in enumerate(photographs.directions.astype(np.float32)):
        if light in pick:
            continue
        observed = photographs.images[light] - ambient
        lit = mask & (observed > _DARK * np.quantile(observed[mask], 0.99))
        if np.count_nonzero(lit) < _FEWEST_PX:
            continue
        predicted = (surface.albedo * np.maximum(normals @ direction, 0.0))[lit]
        values = observed[lit]
        gain = np.median(values / np.maximum(predicted, 1e-6))
        errors = np.abs(gain * predicted - values) / values.mean()
        medians.append(float(np.median(errors)))
        means.append(float(np.minimum(errors, 1.0).mean()))
    return (float(np.mean(medians)), float(np.mean(means))) if medians else None


def _changed_share(
    photographs: PhotographSet, pick: Pick, method: Method, planar: bool, surface: SurfaceEstimate
) -> float:
    rotated, mirrored = (
        solve_pick(each, pick, method, planar)
        for each in (photographs.rotated(), photographs.mirrored())
    )
    changed = (
        (np.rot90(rotated.q, -1) - surface.p, np.rot90(-rotated.p, -1) - surface.q),
        (-mirrored.p[:, ::-1] - surface.p, mirrored.q[:, ::-1] - surface.q),
    )
    return max(
        float((np.maximum(np.abs(p), np.abs(q)) > _CHANGED)[photographs.mask].mean())
        for p, q in changed
    )
