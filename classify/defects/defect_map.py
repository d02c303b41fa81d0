"""`DefectMap` of a part, and the regions in which it exceeds the limit."""

from dataclasses import dataclass, replace
from typing import Final, Literal, Self

import cv2
import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap

CELL_PX: Final = 8
"""Pixels on a side of one cell of a defect map."""

_Kind = Literal["relief", "albedo", "texture"]
KINDS: Final[tuple[_Kind, ...]] = ("relief", "albedo", "texture")


@dataclass(frozen=True, eq=False)
class DefectMap:
    """Scores of the cells of a part, (h, w) float32; 1.0 is the limit.

    Cells with too few valid pixels are NaN in all maps. The last row and column may cover less than
    `CELL_PX` pixels of the frame.

    Attributes
    ----------
    relief
        Spots and scratches of the relief: the highest departure in units of its limit, or their
        share in the sum of `score` if that is larger.
    albedo
        Spots and lines of the log albedo.
    texture
        Local statistics: another texture, or a missing one. The highest departure in units of its
        limit, or half of their share in the sum if that is larger.
    score
        The larger of two: the highest departure in units of its limit, and the sum of the evidence
        of all departures in units of the limit of the sum.
    shape
        Rows and columns of the frame, px.
    """

    relief: FloatMap
    albedo: FloatMap
    texture: FloatMap
    score: FloatMap
    shape: tuple[int, int]
    cell_px: int = CELL_PX

    def in_units_of(self, limit: float | None) -> Self:
        """Return the scores divided by another limit; None divides by 1.0."""
        unit = 1.0 if limit is None else limit
        return replace(self, **{name: getattr(self, name) / unit for name in (*KINDS, "score")})

    @property
    def worst(self) -> float:
        """The largest score of the part; NaN if no cell is valid."""
        return float(np.fmax.reduce(self.score, axis=None))


@dataclass(frozen=True, eq=False)
class DefectRegion:
    """A connected region of cells above the limit.

    Attributes
    ----------
    kind
        The kind with the largest share of the highest score. It is relief or albedo if its spots
        and lines alone exceed 1.0, because they change the local statistics too.
    box
        x, y, width, height in pixels of the frame: column and row of the upper left corner.
    area_px
        Number of its cells times `cell_px`^2; a cell that the frame cuts counts in full.
    score
        The highest score in the region.
    outline
        (n, 2) int32 x and y of the corners of its outer boundary, pixels of the frame.
    """

    kind: _Kind
    box: tuple[int, int, int, int]
    area_px: int
    score: float
    outline: npt.NDArray[np.int32]


def regions_of(defect_map: DefectMap) -> tuple[DefectRegion, ...]:
    """Outline the connected cells above 1.0, the highest score first."""
    score = defect_map.score
    above = (score > 1.0).astype(np.uint8)
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(above, connectivity=8)
    rows, columns = defect_map.shape
    cell = defect_map.cell_px
    regions = []
    for label in range(1, count):
        left, top, width, height, cells = map(int, boxes[label])
        box_slice = np.s_[top : top + height, left : left + width]
        inside = labels[box_slice] == label
        peak = int(np.argmax(np.where(inside, score[box_slice], -np.inf)))
        shares = {kind: float(getattr(defect_map, kind)[box_slice].flat[peak]) for kind in KINDS}
        # Cells as blocks of pixels: the outline follows their borders.
        block = np.kron(inside.astype(np.uint8), np.ones((cell, cell), np.uint8))
        outlines, _ = cv2.findContours(block, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        outline = outlines[0][:, 0] + np.array([left * cell, top * cell])
        outline = np.minimum(outline, [columns - 1, rows - 1]).astype(np.int32)
        box = (
            left * cell, top * cell,
            min(width * cell, columns - left * cell), min(height * cell, rows - top * cell),
        )  # fmt: skip
        highest = float(score[box_slice].flat[peak])
        regions.append(DefectRegion(_kind_of(shares), box, cells * cell**2, highest, outline))
    return tuple(sorted(regions, key=lambda region: -region.score))


def _kind_of(shares: dict[_Kind, float]) -> _Kind:
    spot_kind: _Kind = "relief" if shares["relief"] >= shares["albedo"] else "albedo"
    return spot_kind if shares[spot_kind] > 1.0 else max(shares, key=lambda kind: shares[kind])
