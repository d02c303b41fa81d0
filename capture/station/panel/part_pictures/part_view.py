"""`PartView`: the solved surface of a stored part, in its frame, with outlined defects."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from capture.base.errors import CalibrationError
from capture.sets.captured_set import CapturedSet, LoadedSet
from capture.station.domain.folder import StationFolder
from capture.station.domain.recipe import Region
from capture.station.judge.measured_surface import MeasuredSurface, fits
from capture.station.results.part_result import DefectRecord, PartResult
from classify import DefectMap, regions_of
from classify.base.errors import InputError
from classify.defects.defect_map import KINDS
from classify.surface.estimate import FloatMap

from .judged_by import JudgedBy, judged_by

Outline = tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class PartView:
    """The solved surface of a stored part, in maps of the shape of its frame."""

    # Outside the judged region, the maps are 0, and `score` is NaN.

    captured: CapturedSet
    region: Region | None  # None for the whole frame
    normals: FloatMap
    albedo: FloatMap
    shadow_count: npt.NDArray[np.uint8]
    valid: npt.NDArray[np.bool_]
    # 1 is the limit of the recipe, NaN is no score; None without a defect map.
    score: FloatMap | None
    # Columns and rows of the corners of each defect of the result, in order.
    outlines: tuple[Outline, ...]
    notes: tuple[str, ...] = ()  # possible differences between the pictures and the inspection


def part_view(folder: StationFolder, result: PartResult, path: Path) -> PartView:
    """Solve the stored set of a part as the station did, if it is the set that was judged."""
    notes: list[str] = []
    try:
        loaded = LoadedSet.of(path)
    except CalibrationError as error:
        loaded = LoadedSet(CapturedSet.load(path), None)
        notes.append(f"solved without its calibration: {error}")
    captured = loaded.captured
    if captured.metadata.pixels_sha256 != result.set_sha256:
        raise InputError(f"{path}: is another set than the one that was judged")
    judged: JudgedBy | None = None
    region: Region | None = None
    try:
        judged = judged_by(folder, result)
        region = judged.recipe.region
    except InputError as error:
        notes.append(f"the whole frame is shown, solved by the default method: {error}")
    frame = captured.images.shape[1:]
    if not fits(region, frame):
        region = None
    method = None if judged is None else judged.method
    measured = MeasuredSurface.of(captured, region, loaded.found_calibration, method)
    scores = _scores(judged, measured, result)
    outlines = _outlines(scores, region, result.defects)
    if result.defects and outlines is None:
        notes.append("the defects are boxes: their outlines cannot be made again")
    surface = measured.surface

    def placed(part: npt.NDArray[Any], outside: float = 0.0) -> npt.NDArray[Any]:
        if region is None:
            return part
        whole = np.full((*frame, *part.shape[2:]), outside, part.dtype)
        whole[region.y : region.y + region.height, region.x : region.x + region.width] = part
        return whole

    return PartView(
        captured=captured,
        region=region,
        normals=placed(surface.normals),
        albedo=placed(surface.albedo),
        shadow_count=placed(surface.shadow_count),
        valid=placed(surface.valid),
        score=None if scores is None else placed(_in_pixels(scores), np.nan),
        outlines=tuple(map(_box, result.defects)) if outlines is None else outlines,
        notes=tuple(notes),
    )


def _scores(
    judged: JudgedBy | None, measured: MeasuredSurface, result: PartResult
) -> DefectMap | None:
    """The defect map of a part, in units of the limit of its recipe."""
    if judged is None or judged.defect_model is None or result.orientation_deg is None:
        return None
    defect_map = judged.defect_model.map_of(measured.surface, result.orientation_deg)
    return defect_map.in_units_of(
        judged.recipe.limits_for(result.label or result.nearest or "").defect
    )


def _in_pixels(scores: DefectMap) -> FloatMap:
    cell, (rows, columns) = scores.cell_px, scores.shape
    whole: FloatMap = scores.score.repeat(cell, axis=0).repeat(cell, axis=1)[:rows, :columns]
    return whole


def _outlines(
    scores: DefectMap | None, region: Region | None, defects: Sequence[DefectRecord]
) -> tuple[Outline, ...] | None:
    """Outline recorded defects, then windows; None if the map shows other defects than these."""
    if scores is None:
        return None
    left, top = (0, 0) if region is None else (region.x, region.y)
    windows = [defect for defect in defects if defect.kind not in KINDS]
    defects = [defect for defect in defects if defect.kind in KINDS]
    regions = regions_of(scores)[: len(defects)]
    boxes = [(left + x, top + y, width, height) for x, y, width, height in
             (region.box for region in regions)]  # fmt: skip
    if boxes != [(defect.column, defect.row, defect.width, defect.height) for defect in defects]:
        return None
    corner = np.array([left, top])
    outlines = [tuple((int(x), int(y)) for x, y in region.outline + corner) for region in regions]
    return (*outlines, *map(_box, windows))


def _box(defect: DefectRecord) -> Outline:
    left, top = defect.column, defect.row
    right, bottom = left + defect.width - 1, top + defect.height - 1
    return ((left, top), (right, top), (right, bottom), (left, bottom))
