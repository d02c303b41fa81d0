"""The preview page of a session: live images and the required placement of a specimen."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Self

import cv2
import numpy as np

from capture.sets.captured_set import CapturedSet, LoadedSet
from classify import InputError, Lighting, Ps4rigError, photometric_stereo
from classify.base.arrays import Array, BoolArray, FloatMap
from classify.base.regular_file import read_once
from rig import Frame, HardwareError, Rig

from .events import PlaceSpecimen
from .folder import SessionFolder
from .journal import SetEntry
from .measures import SpecimenReference
from .preview_loop import Preview, show_lights

# Largest share of the frame, and of its border, that a part with an outline covers.
_MAX_SHARE, _MAX_BORDER_SHARE = 0.9, 0.25
# Smallest share of the frame that is a part and not dust.
_MIN_SHARE = 0.01
# Least separation of part and ground by Otsu's criterion, the variance between the two over that of
# all pixels. Evenly spread values have 0.75, normally distributed ones 2/pi = 0.64. With 0.5,
# test_outline.py finds a part in a texture that fills the frame.
_MIN_SEPARATION = 0.75
# Share of the pixels that are drawn as edges of a texture that fills the frame (test_outline.py).
# More hide the texture.
_EDGE_SHARE = 0.02
# Shorter edges do not show the orientation.
_MIN_EDGE_PX = 12
_MAX_LINES = 300
# Largest distance of the simplified line from the contour; lines are 2 px wide.
_TOLERANCE_PX = 0.7


@dataclass(frozen=True, eq=False)
class Outline:
    """Lines over a frame."""

    width_px: int
    height_px: int
    lines: tuple[FloatMap, ...]  # closed, (n, 2): x, y down in px from the top left pixel

    @classmethod
    def of(cls, captured: CapturedSet) -> Self:
        """Find the outline of the part in a set, else the strongest edges of a texture."""
        images = captured.images.astype(np.float32)
        if captured.ambient is not None:
            images -= captured.ambient
        # The mean of all lights has the least shading, and shows the part against its ground.
        mean = cv2.GaussianBlur(images.mean(axis=0), (0, 0), 1.0)
        rows, columns = mean.shape
        part = captured.mask if captured.mask is not None else _part_in(mean)
        if part is None:
            return cls(columns, rows, _edges(images))
        contours = _contours(part)
        lines = [max(contours, key=cv2.contourArea)] if contours else []
        return cls(columns, rows, _simplified(lines))

    def rotated(self, angle_deg: float) -> Self:
        """Rotate the lines anticlockwise about the middle of the frame."""
        middle = np.array([self.width_px - 1, self.height_px - 1]) / 2.0
        angle = np.radians(angle_deg)
        cosine, sine = np.cos(angle), np.sin(angle)
        # y points down: anticlockwise is x' = x cos + y sin, y' = y cos - x sin.
        rotation = np.array([[cosine, -sine], [sine, cosine]])
        lines = tuple(
            ((line - middle) @ rotation + middle).astype(np.float32) for line in self.lines
        )
        return replace(self, lines=lines)

    def svg(self) -> str:
        """Return an SVG image of the size of the frame."""
        paths = "".join(
            "M" + "L".join(f"{x + 0.5:.1f} {y + 0.5:.1f}" for x, y in line.tolist()) + "Z"
            for line in self.lines
        )
        style = 'fill="none" stroke-linejoin="round" vector-effect="non-scaling-stroke"'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{self.width_px}" '
            f'height="{self.height_px}" viewBox="0 0 {self.width_px} {self.height_px}">'
            # A dark line below a bright one is visible on any ground.
            f'<path d="{paths}" stroke="#000" stroke-opacity="0.5" stroke-width="4" {style}/>'
            f'<path d="{paths}" stroke="#ffd400" stroke-width="2" {style}/></svg>'
        )


def _part_in(mean: FloatMap) -> BoolArray | None:
    """Pixels of the largest part that is brighter or darker than the ground; None without one."""
    low, high = np.percentile(mean, (1, 99))
    grey = np.clip((mean - low) * (255.0 / max(high - low, 1e-6)), 0, 255).astype(np.uint8)
    level, _ = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    bright = grey > level
    share = float(bright.mean())
    if not 0.0 < share < 1.0:
        return None
    variance_between = share * (1.0 - share) * (grey[bright].mean() - grey[~bright].mean()) ** 2
    if variance_between < _MIN_SEPARATION * grey.var():
        return None
    border = np.concatenate([bright[0], bright[-1], bright[:, 0], bright[:, -1]])
    part = ~bright if border.mean() > 0.5 else bright
    # The relief of the part casts shadows, and its gloss shines: holes are closed.
    radius = max(1, min(grey.shape) // 100)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    closed = cv2.morphologyEx(part.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(closed)
    if count < 2:
        return None
    largest = labels == 1 + int(statistics[1:, cv2.CC_STAT_AREA].argmax())
    edge = np.concatenate([largest[0], largest[-1], largest[:, 0], largest[:, -1]])
    if not _MIN_SHARE < largest.mean() < _MAX_SHARE or edge.mean() > _MAX_BORDER_SHARE:
        return None
    return np.asarray(largest, np.bool_)


def _edges(images: FloatMap) -> tuple[FloatMap, ...]:
    """The strongest edges under all lights."""
    strength = np.zeros(images.shape[1:], np.float32)
    for image in images:
        smooth = cv2.GaussianBlur(image, (0, 0), 2.0)
        across, down = (cv2.Sobel(smooth, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
        strength += cv2.magnitude(across, down)
    strong = strength > np.quantile(strength, 1.0 - _EDGE_SHARE)
    longest = sorted((line for line in _contours(strong) if len(line) >= _MIN_EDGE_PX), key=len)
    return _simplified(longest[-_MAX_LINES:])


def _contours(pixels: BoolArray) -> Sequence[Array]:
    mask = pixels.astype(np.uint8)
    return cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]


def _simplified(lines: Iterable[Array]) -> tuple[FloatMap, ...]:
    return tuple(
        cv2.approxPolyDP(line, _TOLERANCE_PX, True).reshape(-1, 2).astype(np.float32)
        for line in lines
    )


# Largest error of a good placement: parts are placed by hand within 2 degrees by the outline
# (tests/capture/preview/test_outline.py).
_GOOD_DEG = 2.0


@dataclass(frozen=True, eq=False)
class PlacementGuide:
    """The first set of a specimen, and the required orientation."""

    outline: Outline  # of the first placement, rotated to the required orientation
    reference: SpecimenReference
    required_deg: float

    @classmethod
    def of(cls, first: Path, required_deg: float | None = None) -> Self:
        """Make the guide from the first set of a specimen, by default for its orientation."""
        outline, reference, first_deg = _first_placement(first)
        required_deg = first_deg if required_deg is None else required_deg
        return cls(outline.rotated(required_deg - first_deg), reference, required_deg)

    def orientation_text(self, lighting: Lighting, frames: Sequence[Frame]) -> str | None:
        """Say how a part lies, from a frame under each light; None if that is undetermined."""
        images = np.stack([frame.pixels for frame in frames])
        full_scale = (1 << frames[0].bit_depth) - 1
        try:
            surface = photometric_stereo(images, lighting, full_scale=full_scale, planar=True)
        except InputError:
            return None  # saturated or dark, which the page shows
        now_deg = self.reference.orientation_deg(surface, self.required_deg)
        if now_deg is None:
            return None
        error_deg = self.required_deg - now_deg
        direction = "anticlockwise" if error_deg > 0.0 else "clockwise"
        request = (
            "good"
            if abs(error_deg) <= _GOOD_DEG
            else f"turn it by {abs(error_deg):.0f} {direction}"
        )
        return f"now at {now_deg:.1f} degrees: {request}"


@read_once(files=1)
def _first_placement(first: Path) -> tuple[Outline, SpecimenReference, float]:
    """Outline, texture and orientation of the first placement, kept for the next one."""
    loaded = LoadedSet.of(first)
    return (
        Outline.of(loaded.captured),
        SpecimenReference(loaded),
        loaded.captured.metadata.orientation_deg or 0.0,
    )


class LiveView:
    """Contents of the page: live images, the outline of the required placement, the last set."""

    def __init__(self, folder: SessionFolder) -> None:
        self._folder = folder
        self.preview = Preview()

    def show_captured(self, entry: SetEntry) -> None:
        """Show the orientation of the set that was just captured."""
        measures, text = entry.measures, f"{entry.file}: captured"
        if measures is not None and measures.estimated_deg is not None:
            text += (
                f" at {measures.estimated_deg:.1f} degrees, {entry.orientation_deg:g} were asked"
            )
        self.preview.show_set_measurement(text)

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
            self.preview.store_error(error)
            rig = None
        place = f"turn to {planned.orientation_deg:g} degrees" if first else "first placement"
        self.preview.guide(f"{planned.specimen}: {place}", guide.outline.svg() if guide else None)
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
            self.preview.store_error(error)
