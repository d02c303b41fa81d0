"""The preview page of a session: live images while a person places a specimen."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from threading import Event, Thread

from capture.session.preview_loop import Preview, show_lights
from classify.base.errors import InputError, Ps4rigError
from rig import HardwareError, Rig

from .events import PlaceSpecimen
from .folder import SessionFolder
from .journal import SetEntry
from .placement_guide import PlacementGuide


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
