"""Measures of a set against the first set of its specimen, after its capture and corrections."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import cv2
import numpy as np

from capture.sets.archive import JOURNAL
from capture.sets.captured_set import CapturedSet, LoadedSet
from capture.sets.metadata import SetMetadata
from capture.sets.ome_tiff import read_header
from classify import InputError, SurfaceEstimate, TextureLibrary
from classify.lighting import orientation_near
from classify.texture.orientation import MIN_SHARPNESS
from rig.acceptance import MAX_SATURATED_SHARE

from .folder import SETS, SessionFolder, session_folder
from .journal import Description, SetEntry, SetMeasures

# Largest error of a placement without a warning. Parts are placed by hand within 2 degrees by the
# overlay of the preview and within 5 by eye; a wrong digit is 10 degrees or more.
_MAX_PLACEMENT_DEG = 8.0
# An entered orientation is doubted if its agreement is this much below the best. A weave agrees as
# well after a rotation by 90 degrees (tests/evidence/orientation_flags.py).
_MIN_DROP = 0.03
# Blur that costs the statistics of the finest scale (classify/texture/blur.py).
_MAX_BLUR_PX = 1.0
# Largest relative change of the sum of the light images, which on a matt surface does not depend on
# the orientation.
_MAX_SIGNAL_CHANGE = 0.1


class SpecimenReference:
    """The first set of a specimen, with which its later sets are compared."""

    def __init__(self, loaded: LoadedSet) -> None:
        self._orientation_deg = loaded.captured.metadata.orientation_deg
        self._signal = float(np.sum(light_signals(loaded.captured)))
        self._library: TextureLibrary | None = None
        try:
            surface = _solved(loaded)
            reference = ("specimen", surface, self._orientation_deg or 0.0)
            self._library = TextureLibrary.train([reference])
        except InputError:
            pass  # too small or too empty for a texture: no orientation, and no focus

    def compared(
        self, captured: CapturedSet, surface: SurfaceEstimate, measures: SetMeasures
    ) -> SetMeasures:
        """Add the differences of a set from this reference to its measures."""
        warnings, signal = [*measures.warnings], sum(measures.led_levels)
        if abs(signal / self._signal - 1.0) > _MAX_SIGNAL_CHANGE:
            warnings.append(
                f"light changed by {signal / self._signal - 1.0:+.0%} since the first set of the "
                "specimen"
            )
        entered_deg, blur_px = captured.metadata.orientation_deg, self._blur_px(surface)
        estimated_deg = None
        if self._orientation_deg is not None:
            estimated_deg = self.orientation_deg(surface, entered_deg)
        if (
            estimated_deg is not None
            and entered_deg is not None
            and abs(estimated_deg - entered_deg) > _MAX_PLACEMENT_DEG
        ):
            warnings.append(
                f"the texture stands at {estimated_deg:.0f} degrees, {entered_deg:g} were entered"
            )
        if blur_px is not None and blur_px > _MAX_BLUR_PX:
            warnings.append(f"{blur_px:.1f} px blurrier than the first set of the specimen")
        estimates = {"estimated_deg": estimated_deg, "blur_px": blur_px}
        return measures.model_copy(update={**estimates, "warnings": tuple(warnings)})

    def orientation_deg(
        self, surface: SurfaceEstimate, entered_deg: float | None = None
    ) -> float | None:
        """Orientation nearest to `entered_deg` modulo 180; None if the texture determines none.

        It is relative to the first set of the specimen if that set has no orientation.
        """
        profile = None
        if self._library is not None:
            with suppress(InputError):
                profile = self._library.orientation_profile(surface)
        if profile is None:
            return None
        best_deg, agreement = profile.best()
        if agreement < MIN_SHARPNESS:
            return None
        if entered_deg is not None:
            near_deg, near_agreement = profile.best(entered_deg, _MAX_PLACEMENT_DEG)
            if agreement - near_agreement < _MIN_DROP:
                best_deg = near_deg
            return orientation_near(best_deg, entered_deg)
        return best_deg

    def _blur_px(self, surface: SurfaceEstimate) -> float | None:
        if self._library is None:
            return None
        try:
            return self._library.classify(surface).blur_px
        except InputError:
            return None


def measures_of(loaded: LoadedSet, reference: SpecimenReference | None) -> SetMeasures:
    """Measure a set, and compare it with its specimen, unless it is the first one.

    `orientation_deg` of its metadata is the one that was entered.
    """
    captured, surface = loaded.captured, _solved(loaded)
    saturated, shadowed = float(surface.saturated.mean()), float(surface.shadow_mask.mean())
    is_saturated = saturated > MAX_SATURATED_SHARE
    measures = SetMeasures(
        led_levels=light_signals(captured),
        saturated=saturated,
        shadowed=shadowed,
        warnings=(f"{saturated:.1%} of the pixels are saturated",) if is_saturated else (),
    )
    return measures if reference is None else reference.compared(captured, surface, measures)


def _solved(loaded: LoadedSet) -> SurfaceEstimate:
    return loaded.solve_texture(None, planar=True)


def light_signals(captured: CapturedSet) -> tuple[float, ...]:
    """Mean signal of each light, without ambient light, as a share of full scale."""
    # Several times as fast as a mean of numpy, and as exact.
    lit = np.array([cv2.mean(image)[0] for image in captured.images])
    if captured.ambient is not None:
        lit -= cv2.mean(captured.ambient)[0]
    return tuple((lit / captured.metadata.full_scale).tolist())


def correct_in_sessions(paths: Iterable[Path], correct: Callable[[], None]) -> None:
    """Correct sets by `correct`, also in their sessions; none if a session is in use."""
    files = {path.resolve() for path in paths}
    folders = {path.parent.parent for path in files if path.parent.name == SETS}
    with ExitStack() as stack:
        sessions = [
            stack.enter_context(session_folder(folder))
            for folder in sorted(folders)
            if (folder / JOURNAL).is_file()
        ]
        correct()
        for session in sessions:
            enter_corrections(
                session,
                [
                    (entry, read_header(path)[0])
                    for entry in session.captured()
                    if (path := session.path / str(entry.file)) in files
                ],
            )


def enter_corrections(
    folder: SessionFolder, described_sets: Iterable[tuple[SetEntry, SetMetadata]]
) -> None:
    """Enter the present metadata of captured sets into the journal.

    If the specimen or orientation of a set changed, all sets of its specimens are measured again.
    """
    journal, changed_specimens = folder.journal, set[str]()
    for entry, metadata in described_sets:
        changed = entry.model_copy(update={"description": Description.of(metadata)})
        if changed != entry:
            journal = journal.with_entry(changed)
        if (changed.entered_specimen, changed.entered_deg) != (
            entry.entered_specimen,
            entry.entered_deg,
        ):
            changed_specimens |= {changed.entered_specimen, entry.entered_specimen}
    if journal is folder.journal:
        return
    folder.update(journal)
    for specimen in changed_specimens:
        for entry in _measured_again(folder.sets_of(specimen), folder.path):
            journal = journal.with_entry(entry)
    folder.update(journal)


def _measured_again(entries: Iterable[SetEntry], folder: Path) -> Iterator[SetEntry]:
    """Measure the sets of a specimen against the first of them; a damaged one stays as it is."""
    reference: SpecimenReference | None = None
    for entry in entries:
        try:
            loaded = LoadedSet.of(folder / (entry.file or ""))
            measures = measures_of(loaded, reference)
            if reference is None and entry.entered_specimen:
                reference = SpecimenReference(loaded)
        except InputError:
            continue
        yield entry.model_copy(update={"measures": measures})
