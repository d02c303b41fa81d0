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
    judge: JudgedBy | None = None
    region: Region | None = None
    try:
        judge = judged_by(folder, result)
        region = judge.recipe.region
    except InputError as error:
        notes.append(f"the whole frame is shown, solved by the default method: {error}")
    frame = captured.images.shape[1:]
    # A part whose images are smaller than the region has the verdict ERROR.
    if not fits(region, frame):
        region = None
    method = None if judge is None else judge.method
    measured = MeasuredSurface.of(captured, region, loaded.found_calibration, method)
    scaled_map = _scaled_defect_map(judge, measured, result)
    outlines = _outlines(scaled_map, region, result.defects)
    if result.defects and outlines is None:
        notes.append("the defects are boxes: their outlines cannot be made again")
    surface = measured.surface

    def in_frame(region_map: npt.NDArray[Any], outside: float = 0.0) -> npt.NDArray[Any]:
        if region is None:
            return region_map
        whole = np.full((*frame, *region_map.shape[2:]), outside, region_map.dtype)
        whole[region.y : region.y + region.height, region.x : region.x + region.width] = region_map
        return whole

    return PartView(
        captured=captured,
        region=region,
        normals=in_frame(surface.normals),
        albedo=in_frame(surface.albedo),
        shadow_count=in_frame(surface.shadow_count),
        valid=in_frame(surface.valid),
        score=None if scaled_map is None else in_frame(_score_per_pixel(scaled_map), np.nan),
        outlines=tuple(map(_box, result.defects)) if outlines is None else outlines,
        notes=tuple(notes),
    )


def _scaled_defect_map(
    judge: JudgedBy | None, measured: MeasuredSurface, result: PartResult
) -> DefectMap | None:
    """The defect map of a part, in units of the limit of its recipe."""
    if judge is None or judge.defect_model is None or result.orientation_deg is None:
        return None
    defect_map = judge.defect_model.map_of(measured.surface, result.orientation_deg)
    return defect_map.in_units_of(
        judge.recipe.limits_for(result.label or result.nearest or "").defect
    )


def _score_per_pixel(scaled_map: DefectMap) -> FloatMap:
    cell, (rows, columns) = scaled_map.cell_px, scaled_map.shape
    whole: FloatMap = scaled_map.score.repeat(cell, axis=0).repeat(cell, axis=1)[:rows, :columns]
    return whole


def _outlines(
    scaled_map: DefectMap | None, region: Region | None, defects: Sequence[DefectRecord]
) -> tuple[Outline, ...] | None:
    """Outline recorded defects, then windows; None if the map shows other defects than these."""
    if scaled_map is None:
        return None
    left, top = (0, 0) if region is None else (region.x, region.y)
    windows = [defect for defect in defects if defect.kind not in KINDS]
    defects = [defect for defect in defects if defect.kind in KINDS]
    regions = regions_of(scaled_map)[: len(defects)]
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
