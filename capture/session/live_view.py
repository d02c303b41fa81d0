"""The preview page of a session: live images and the required placement of a specimen."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from threading import Event, Thread
from typing import Self

import numpy as np

from capture.sets.captured_set import LoadedSet
from classify import Lighting, photometric_stereo
from classify.base.errors import InputError, Ps4rigError
from rig import Frame, HardwareError, Rig

from .events import PlaceSpecimen
from .folder import SessionFolder
from .journal import SetEntry
from .measures import SpecimenReference
from .preview_loop import Preview, show_lights
from .preview_outline import Outline, outline_of

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


class LiveView:
    """Contents of the page: live images, the outline of the asked placement, the last set."""

    def __init__(self, folder: SessionFolder) -> None:
        self._folder = folder
        self.preview = Preview()

    def captured(self, entry: SetEntry) -> None:
        """Show the orientation of the set that was just captured."""
        measures, text = entry.measures, f"{entry.file}: captured"
        if measures is not None and measures.estimated_deg is not None:
            text += (
                f" at {measures.estimated_deg:.1f} degrees, {entry.orientation_deg:g} were asked"
            )
        self.preview.captured(text)

    @contextmanager
    def placing(self, question: PlaceSpecimen) -> Iterator[None]:
        """Show the rig and the outline of the first placement while the block runs."""
        planned, guide = question.planned, None
        first = self._folder.first_set_of(planned.specimen)
        try:
            if first is not None:
                guide = PlacementGuide.of(first, planned.orientation_deg)
            rig = None if question.live_rig is None else question.live_rig()
        except Ps4rigError as error:  # the capture that follows will say more
            self.preview.failed(error)
            rig = None
        place = f"turn to {planned.orientation_deg:g} degrees" if first else "first placement"
        self.preview.guide(f"{planned.specimen}: {place}", guide.outline if guide else None)
        stopping = Event()
        thread = Thread(target=self._show, args=(rig, guide, stopping), daemon=True)
        thread.start()
        try:
            yield
        finally:
            stopping.set()
            thread.join()

    def _show(self, rig: Rig | None, guide: PlacementGuide | None, stopping: Event) -> None:
        if rig is None:
            return
        self.preview.now_s = rig.clock.now_s
        try:
            if rig.config.lights.synchronisation != "software":
                raise InputError("live images need lights.synchronisation = 'software' in rig.toml")
            measure = None if guide is None else partial(guide.orientation_text, rig.lighting)
            show_lights(rig, self.preview, stopping, measure)
            rig.lights.off()
        except (HardwareError, InputError) as error:
            self.preview.failed(error)
