"""`MeasuredSurface`: the solved region of a part, as the inspector and teaching use it."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from capture.calibration.lookup import FoundCalibration
from capture.session.measures import light_signals
from capture.sets.captured_set import PLANAR, CapturedSet, LoadedSet
from capture.station.domain.recipe import Region
from classify import DefectMap, Method, SurfaceEstimate
from classify.relief.roughness import root_mean_square_slope

_MASK_FILE = "region"


@dataclass(frozen=True, eq=False)
class MeasuredSurface:
    """The region of a part, solved."""

    surface: SurfaceEstimate  # without images if the region is not the whole frame
    inside: npt.NDArray[np.bool_]  # (H, W) bool of the region, false outside the mask of the set
    shadowed: npt.NDArray[np.bool_]  # (H, W) bool, pixels that at least one light does not reach
    saturated: npt.NDArray[np.bool_]  # (H, W) bool, pixels that at least one light saturates
    light_signals: tuple[float, ...]  # mean of each light in the region, as a share of full scale

    @classmethod
    def of(
        cls,
        captured: CapturedSet,
        region: Region | None,
        calibration: FoundCalibration | None,
        method: Method | None,
        *,
        uncertainty: bool = False,
    ) -> Self:
        """Solve a set by `method`, or by the default for its lights, and crop it to a region.

        The whole frame is solved, because lights and calibration refer to it; pixels outside of the
        region are masked.
        """
        frame = captured.images.shape[1:]
        inside = np.ones(frame, np.bool_) if captured.mask is None else captured.mask
        if region is not None:
            in_region = np.zeros(frame, np.bool_)
            _cut(in_region, region)[...] = True
            inside = inside & in_region
            metadata = captured.metadata.model_copy(update={"mask_file": _MASK_FILE})
            captured = replace(captured, mask=inside, metadata=metadata)
        whole = LoadedSet(captured, calibration).solve_texture(
            method, planar=PLANAR, uncertainty=uncertainty
        )
        part = replace(
            captured,
            images=_cut(captured.images, region),
            ambient=None if captured.ambient is None else _cut(captured.ambient, region),
            mask=None if captured.mask is None else _cut(captured.mask, region),
        )
        surface = whole
        if region is not None:
            rows = slice(region.y, region.y + region.height)
            surface = whole.cropped(rows, slice(region.x, region.x + region.width))
        return cls(
            surface,
            _cut(inside, region),
            _cut(whole.shadow_mask, region),
            _cut(whole.saturated, region),
            light_signals(part),
        )

    def share(self, where: npt.NDArray[np.bool_]) -> float:
        """Share of the pixels in `inside` where `where` is true; NaN if `inside` is empty."""
        count = np.count_nonzero(self.inside)
        return np.count_nonzero(where & self.inside) / count if count else float("nan")

    def largest_gap_px(self, defect_map: DefectMap) -> int:
        """Largest connected area of unscored cells that are at least half inside, in px."""
        rows, columns = defect_map.score.shape
        cell = defect_map.cell_px
        height, width = self.inside.shape
        # The last cells may exceed the region.
        margins = [(0, rows * cell - height), (0, columns * cell - width)]
        inside = np.pad(self.inside.astype(np.float32), margins)
        share = cv2.resize(inside, (columns, rows), interpolation=cv2.INTER_AREA)
        gaps = (np.isnan(defect_map.score) & (share >= 0.5)).astype(np.uint8)
        _, _, statistics, _ = cv2.connectedComponentsWithStats(gaps, connectivity=8)
        return cell * cell * int(statistics[1:, cv2.CC_STAT_AREA].max(initial=0))

    @property
    def unmeasured_fraction(self) -> float:
        """Share of the pixels without a slope."""
        return self.share(~self.surface.valid)

    @property
    def albedo(self) -> float:
        """Mean albedo of the valid pixels; NaN if there are none."""
        valid = self.surface.valid
        return float(self.surface.albedo[valid].mean()) if valid.any() else float("nan")

    @property
    def angle_sd(self) -> float | None:
        """Median standard deviation of the normal, degrees; None if it was not requested."""
        if self.surface.angle_sd is None:
            return None
        deviations = self.surface.angle_sd[self.surface.valid]
        return float(np.median(deviations)) if deviations.size else float("nan")

    @cached_property
    def sdq(self) -> float:
        """Root mean square slope (ISO 25178-2); NaN if no pixel has one."""
        return root_mean_square_slope(self.surface)


def fits(region: Region | None, shape: tuple[int, ...]) -> bool:
    """Whether the region lies within images of (rows, columns)."""
    rows, columns = shape
    return region is None or (
        region.x + region.width <= columns and region.y + region.height <= rows
    )


def _cut(plane: npt.NDArray[Any], region: Region | None) -> npt.NDArray[Any]:
    """The region of an (..., H, W) array, as a view."""
    if region is None:
        return plane
    return plane[..., region.y : region.y + region.height, region.x : region.x + region.width]
