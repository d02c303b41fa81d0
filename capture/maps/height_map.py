"""The heights of a captured set in mm, with the facts that files of measured surfaces hold."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

import numpy as np

from capture.base.errors import SetRejected
from capture.sets.captured_set import LoadedSet
from capture.sets.metadata import SetMetadata
from classify import SurfaceEstimate, integrate_gradients
from classify.base.errors import InputError
from classify.surface.estimate import FloatMap


def solved_height(loaded: LoadedSet) -> tuple[SurfaceEstimate, FloatMap]:
    """Solve a set and integrate its slopes: height in px, NaN where no slope is known."""
    surface = loaded.solve()
    if not surface.valid.any():
        raise SetRejected(
            f"{loaded.captured.path}: no pixel can be solved; check exposure and lights"
        )
    height = integrate_gradients(surface.p, surface.q)
    height[~surface.valid] = np.nan
    return surface, height


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights on the grid of the pixels, rows from the top of the image."""

    heights_mm: FloatMap  # (H, W) float32, NaN where no slope is known
    mm_per_px: float
    scale_date: str  # of the measurement of the scale, or of the import that was given it
    captured_at: datetime
    metadata: SetMetadata
    method: str

    @classmethod
    def of(cls, loaded: LoadedSet) -> HeightMap:
        """Solve a set with its calibration, and integrate its slopes."""
        metadata = loaded.captured.metadata
        source, mm_per_px = loaded.found_calibration, loaded.mm_per_px
        if mm_per_px is None:
            raise InputError(
                "has no scale, and the file holds lengths; measure it with ps4rig calibrate scale, "
                "import photographs with --mm-per-px, or export to .ply or .stl"
            )
        scale = None if source is None else source.file.records.get("scale")
        try:
            captured_at = datetime.fromisoformat(metadata.captured or metadata.created_utc)
        except ValueError:
            raise InputError(
                f"metadata field created_utc: {metadata.created_utc!r} is not a date; capture the "
                "part again, or export to .ply or .stl"
            ) from None
        surface, heights_mm = solved_height(loaded)
        heights_mm *= mm_per_px
        return cls(
            heights_mm=heights_mm,
            mm_per_px=mm_per_px,
            scale_date=metadata.created_utc if scale is None else scale.date,
            captured_at=captured_at,
            metadata=metadata,
            method=surface.method,
        )

    @property
    def comment(self) -> str:
        """The set and the source of its heights, as text for the file."""
        metadata = self.metadata
        sentences = (
            "SIMULATED." if metadata.simulated else None,
            metadata.label and f"Label {metadata.label}.",
            metadata.specimen and f"Specimen {metadata.specimen}.",
            f"Heights by photometric stereo ({self.method}), integrated from slopes:",
            "errors of form grow with distance.",
            f"Pixels SHA-256 {metadata.pixels_sha256}.",
        )
        return " ".join(filter(None, sentences))
