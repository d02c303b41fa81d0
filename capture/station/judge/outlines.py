"""Outlines of defects and of unlike windows as records."""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from capture.station.domain.limits import Limits
from capture.station.domain.recipe import Region
from capture.station.results.part_result import DefectRecord
from classify import DefectMap, regions_of
from classify.pieces.features import CELL_PX
from classify.pieces.piece_model import PieceMeasures

# Number of defects that a result lists; a part of another texture may have hundreds.
_MAX_DEFECTS = 50
# Largest number of listed regions of seams, and of windows. Windows that overlap are one region, so
# there are few.
_MAX_WINDOW_REGIONS = 10


def defects_of_map(defect_map: DefectMap, limit: float | None) -> Iterator[DefectRecord]:
    """Outline the defects above a limit; their scores are in units of it."""
    for region in regions_of(defect_map.in_units_of(limit))[:_MAX_DEFECTS]:
        x, y, width, height = region.box
        yield DefectRecord(region.kind, y, x, height, width, region.area_px, region.score)


def defects_of_windows(pieces: PieceMeasures, limits: Limits) -> Iterator[DefectRecord]:
    """Outline connected cells whose windows exceed a limit; their scores are in units of it."""
    for kind, scores, limit in (
        ("seam", pieces.seam_map, limits.seam),
        ("window", pieces.window_map, limits.window),
    ):
        scores = scores / np.float32(1.0 if limit is None else limit)
        above = (scores > 1.0).astype(np.uint8)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(above, connectivity=8)
        for label in range(1, min(count, _MAX_WINDOW_REGIONS + 1)):
            x, y, width, height, cells = (int(value) for value in boxes[label])
            yield DefectRecord(
                kind,
                y * CELL_PX,
                x * CELL_PX,
                height * CELL_PX,
                width * CELL_PX,
                cells * CELL_PX**2,
                float(scores[labels == label].max()),
            )


def in_image(region: Region | None, defect: DefectRecord) -> DefectRecord:
    """Return a defect of a region in coordinates of the whole image."""
    if region is None:
        return defect
    return replace(defect, row=defect.row + region.y, column=defect.column + region.x)
