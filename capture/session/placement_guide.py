"""The required placement of a specimen as an outline, and its present orientation."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np

from capture.session.preview_outline import Outline, outline_of
from capture.sets.loaded_set import LoadedSet
from classify import Lighting, photometric_stereo
from classify.base.errors import InputError
from rig import Frame

from .measures import SpecimenReference

# A hand places a part within 2 degrees by the outline (tests/capture/preview/test_outline.py).
_GOOD_DEG = 2.0


@dataclass(frozen=True, eq=False)
class PlacementGuide:
    """The first set of a specimen, and the orientation that is asked for."""

    outline: Outline  # of the first placement, turned to the asked orientation
    reference: SpecimenReference
    asked_deg: float

    @classmethod
    def of(cls, first: Path, asked_deg: float | None = None) -> Self:
        """Make the guide from the first set of a specimen, by default for its orientation."""
        changed_ns = first.stat().st_mtime_ns if first.is_file() else 0
        outline, reference, first_deg = _known(first, changed_ns)
        asked_deg = first_deg if asked_deg is None else asked_deg
        return cls(outline.rotated(asked_deg - first_deg), reference, asked_deg)

    def orientation_text(self, lighting: Lighting, frames: Sequence[Frame]) -> str | None:
        """Say at which orientation a part lies, from a frame under each light; None if
        undetermined.
        """
        images = np.stack([frame.pixels for frame in frames])
        full_scale = (1 << frames[0].bit_depth) - 1
        try:
            surface = photometric_stereo(images, lighting, full_scale=full_scale, planar=True)
        except InputError:
            return None  # saturated or dark, which the page shows
        now_deg = self.reference.orientation_deg(surface, self.asked_deg)
        if now_deg is None:
            return None
        off_deg = self.asked_deg - now_deg
        direction = "anticlockwise" if off_deg > 0.0 else "clockwise"
        request = (
            "good" if abs(off_deg) <= _GOOD_DEG else f"turn it by {abs(off_deg):.0f} {direction}"
        )
        return f"now at {now_deg:.1f} degrees: {request}"


@lru_cache(maxsize=1)
def _known(first: Path, _mtime_ns: int) -> tuple[Outline, SpecimenReference, float]:
    """Outline, texture and orientation of the first placement, kept for the next one."""
    loaded = LoadedSet.of(first)
    return (
        outline_of(loaded.captured),
        SpecimenReference(loaded),
        loaded.captured.metadata.orientation_deg or 0.0,
    )
