"""Detectability of defects: the strength at which defects put into good parts are found."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

import numpy as np

from classify.base.arrays import Floats
from classify.surface.estimate import FloatMap, SurfaceEstimate

from .defect_map import CELL_PX
from .defect_model import DefectModel
from .shapes import Shape, blot, bump, scratch

_FOUND_SHARE: Final = 0.9
"""Share of the places at which a defect of the stated strength is found."""
MARGIN_PX: Final = 40
"""Distance of a defect from the border of the frame, near which responses fade."""
_SCRATCH_PX: Final = 40.0
"""Length of a scratch."""

# A defect is tried on further parts until it has been tried in the largest number of places, or in
# the least and the ratio of the ends of the 1-sigma interval of its strength is below `_PRECISE`.
_MIN_PLACES, _MAX_PLACES, _PRECISE = 48, 256, 1.15
# Side of the square in the middle of a part to which it is cropped: room for 16 places.
_SIDE_PX = 512
# Grid spacing of the defects on one part, at which no defect changes the score of another, and the
# range of their random offsets from the grid.
_SPACING_PX, _OFFSET_PX = 112.0, 16.0
# Distance from a defect within which a cell can show it; least share of valid pixels of a place.
_REACH_PX = 16.0
_MIN_VALID_SHARE = 0.95
# Weakest tried strength as a share of the strongest; number of bisections between them.
_WEAKEST_SHARE, _STEPS = 1.0 / 128.0, 5
_MIN_SCORE = 1e-3

_Kind = Literal["scratch", "dent", "stain"]
_Piece = tuple[slice, slice]


class KnownDefect(NamedTuple):
    """A kind of defect, and its size: width of a scratch, or diameter of a dent or a stain."""

    kind: _Kind
    size_px: float
    length_px: float = _SCRATCH_PX  # of a scratch

    @property
    def extent_px(self) -> float:
        """Length of a scratch, or diameter of a dent or a stain."""
        return self.length_px if self.kind == "scratch" else self.size_px

    @property
    def strongest(self) -> float:
        """The strongest that is tried: depth in px, or contrast of a stain."""
        return {"scratch": self.size_px, "dent": 0.5 * self.size_px, "stain": 0.8}[self.kind]


DEFECTS: Final = (
    *(KnownDefect("scratch", 2.0 * half_px) for half_px in (1.0, 1.5, 2.5, 4.0)),
    *(KnownDefect("dent", size_px) for size_px in (16.0, 40.0)),
    *(KnownDefect("stain", size_px) for size_px in (16.0, 40.0)),
)


class Place(NamedTuple):
    """Column and row of the middle of a defect, and its anticlockwise angle in radians."""

    column: float
    row: float
    angle: float


@dataclass(frozen=True)
class Detectability:
    """How strong a defect must be to be found in 9 of 10 places."""

    defect: KnownDefect
    # Depth in px, or contrast of a stain; None if not even the strongest that is tried is found.
    strength: float | None


def detectability(
    model: DefectModel,
    parts: Iterable[tuple[SurfaceEstimate, float | None]],
    limit: float = 1.0,
    defects: Sequence[KnownDefect] = DEFECTS,
) -> tuple[Detectability, ...]:
    """Strengths at which 9 of 10 defects in places of good parts are found, by bisection.

    For a single matched filter the strength is limit / d', with d'^2 = sum |d(k)|^2 / S(k) for a
    defect of spectrum d on a texture of power S (North 1943).
    """
    rng = np.random.default_rng(0)
    strengths: dict[KnownDefect, list[float]] = {defect: [] for defect in defects}
    for surface, orientation_deg in parts:
        part = _middle_of(surface)
        unsettled = [defect for defect in defects if not _has_enough_places(strengths[defect])]
        if not unsettled:
            break
        for defect in unsettled:
            places = places_for(part.shape, defect, rng)
            places = [place for place in places if _is_valid(part, defect, place)]
            if places:
                strengths[defect] += _strengths(
                    model, part, orientation_deg or 0.0, limit, defect, places
                )
    return tuple(
        Detectability(defect, stated_strength(strengths[defect]))
        for defect in defects
        if strengths[defect]
    )


def stated_strength(strengths: Sequence[float]) -> float | None:
    """The `_FOUND_SHARE` quantile of the strengths of the places; None if it is infinite."""
    strength = float(np.quantile(strengths, _FOUND_SHARE, method="higher"))
    return strength if math.isfinite(strength) else None


def is_precise(strengths: Sequence[float]) -> bool:
    """Whether the 1-sigma interval of the stated strength, by order statistics, is narrow."""
    ordered, count = np.sort(strengths), len(strengths)
    error = math.sqrt(_FOUND_SHARE * (1.0 - _FOUND_SHARE) * count)
    low, high = (
        ordered[min(int(_FOUND_SHARE * count + offset), count - 1)] for offset in (-error, error)
    )
    return bool(np.isinf(low) or high <= _PRECISE * low)


def places_for(
    shape: tuple[int, int], defect: KnownDefect, rng: np.random.Generator
) -> list[Place]:
    """Places on a jittered grid, so far apart that defects do not interact, at random angles."""
    border_px = MARGIN_PX + 0.5 * defect.extent_px + 0.5 * _OFFSET_PX
    rows, columns = (
        np.linspace(border_px, side - border_px, 1 + int((side - 2.0 * border_px) // _SPACING_PX))
        for side in shape
    )
    offset_px = 0.5 * _OFFSET_PX
    return [
        Place(
            column + rng.uniform(-offset_px, offset_px),
            row + rng.uniform(-offset_px, offset_px),
            rng.uniform(0.0, 2.0 * np.pi),
        )
        for row in rows.tolist()
        for column in columns.tolist()
    ]


def threshold_strengths(
    scores: Callable[[Floats], Floats],
    count: int,
    weakest: float,
    strongest: float,
    steps: int,
) -> Floats:
    """Strength at which the score reaches 1, in each of `count` places.

    It is found by bisection and a last interpolation, and is infinite where the strongest defect is
    not found.
    """

    def logs(strengths: Floats) -> Floats:
        return np.log(np.maximum(scores(np.exp(strengths)), _MIN_SCORE))

    low, high = np.full(count, math.log(weakest)), np.full(count, math.log(strongest))
    above, below = logs(high), np.full(count, np.nan)
    is_ever_found = above > 0.0
    for _ in range(steps):
        middle = 0.5 * (low + high)
        score = logs(middle)
        is_found = score > 0.0
        below, above = np.where(is_found, below, score), np.where(is_found, score, above)
        low, high = np.where(is_found, low, middle), np.where(is_found, middle, high)
    # `below` is NaN where the defect was found in every step: no lower score to interpolate from.
    share = np.where(np.isnan(below), 0.5, -below / np.maximum(above - below, _MIN_SCORE))
    share = np.clip(share, 0.0, 1.0)  # outside of [0, 1] only where no defect is found
    return np.where(is_ever_found, np.exp(low + share * (high - low)), np.inf)


def scores_at(score: FloatMap, defect: KnownDefect, places: Sequence[Place]) -> Floats:
    """The highest score of the cells that can show the defect at each place; 0 without any."""
    reach = 0.5 * defect.extent_px + _REACH_PX
    finite = np.nan_to_num(score)
    return np.array([finite[_piece(score.shape, place, reach, CELL_PX)].max() for place in places])


def with_stamps(
    part: SurfaceEstimate, stamps: Sequence["Stamp"], strengths: Floats
) -> SurfaceEstimate:
    """A part with defects of given depths or contrasts."""
    p, q, albedo = part.p.copy(), part.q.copy(), part.albedo.copy()
    for stamp, strength in zip(stamps, strengths.astype(np.float32), strict=True):
        p[stamp.piece] -= strength * stamp.p
        q[stamp.piece] -= strength * stamp.q
        albedo[stamp.piece] *= 1 - strength * stamp.weight
    return replace(part, p=p, q=q, albedo=albedo)


def _has_enough_places(strengths: Sequence[float]) -> bool:
    count = len(strengths)
    return count >= _MAX_PLACES or (count >= _MIN_PLACES and is_precise(strengths))


def _middle_of(surface: SurfaceEstimate) -> SurfaceEstimate:
    rows, columns = (
        slice(corner, corner + _SIDE_PX)
        for corner in (max(side - _SIDE_PX, 0) // 2 for side in surface.shape)
    )
    p, q, albedo = (plane[rows, columns] for plane in (surface.p, surface.q, surface.albedo))
    return SurfaceEstimate(p, q, albedo, surface.valid[rows, columns], surface.method)


def _is_valid(part: SurfaceEstimate, defect: KnownDefect, place: Place) -> bool:
    around = _piece(part.shape, place, 0.5 * defect.extent_px + _REACH_PX)
    return bool(part.valid[around].mean() >= _MIN_VALID_SHARE)


def _strengths(
    model: DefectModel,
    part: SurfaceEstimate,
    orientation_deg: float,
    limit: float,
    defect: KnownDefect,
    places: Sequence[Place],
) -> list[float]:
    stamps = [Stamp.of(part.shape, defect, place) for place in places]

    def scores(strengths: Floats) -> Floats:
        defect_map = model.map_of(with_stamps(part, stamps, strengths), orientation_deg)
        return scores_at(defect_map.score, defect, places) / limit

    strongest = defect.strongest
    weakest = _WEAKEST_SHARE * strongest
    return [*threshold_strengths(scores, len(places), weakest, strongest, _STEPS)]


class Stamp(NamedTuple):
    """The pixels around a place; slopes of a raised defect and weight of a stain, at strength 1."""

    piece: _Piece
    p: FloatMap
    q: FloatMap
    weight: FloatMap

    @classmethod
    def of(cls, frame: tuple[int, int], defect: KnownDefect, place: Place) -> "Stamp":
        # A groove has ridges beside it.
        reach = 0.5 * defect.extent_px + 3.0 * defect.size_px * (defect.kind == "scratch")
        piece = _piece(frame, place, reach)
        rows, columns = (np.arange(side.start, side.stop) for side in piece)
        right, up = columns[None, :] - place.column, place.row - rows[:, None]
        c, s = math.cos(place.angle), math.sin(place.angle)
        along, across = c * right + s * up, c * up - s * right
        if defect.kind == "stain":
            weight = blot(defect.size_px, along, across).value
            flat = np.zeros(weight.shape, np.float32)
            return cls(piece, flat, flat, weight.astype(np.float32))
        shape: Shape = (
            scratch(defect.length_px, defect.size_px, along, across)
            if defect.kind == "scratch"
            else bump(defect.size_px, along, across)
        )
        p, q = c * shape.along - s * shape.across, s * shape.along + c * shape.across
        return cls(piece, p.astype(np.float32), q.astype(np.float32), np.zeros(p.shape, np.float32))


def _piece(shape: tuple[int, ...], place: Place, reach_px: float, cell_px: int = 1) -> _Piece:
    """Rows and columns of a map whose cells are within `reach_px` of a place."""
    rows, columns = (
        slice(
            max(int((middle - reach_px) / cell_px), 0),
            min(int((middle + reach_px) / cell_px) + 1, side),
        )
        for middle, side in zip((place.row, place.column), shape[:2], strict=True)
    )
    return rows, columns
