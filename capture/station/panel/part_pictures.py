"""Pictures of a stored part as files of bounded size, each with its caption."""

import threading
from collections import OrderedDict
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from capture.maps import pictures
from capture.maps.pictures import ColourScale, Picture
from capture.maps.views import SHOWN_LIGHTS
from capture.station.domain.folder import StationFolder
from capture.station.results.part_result import PartResult
from classify.surface.estimate import FloatMap

from .part_view import Outline, PartView, part_view

# The main picture of the operator's page has 390 px on a screen of 1920 x 1080.
SIZES = {"small": 384, "large": 2 * pictures.PICTURE_PX}
"""Longer side of pictures, in px."""

_JPEG, _PNG = "image/jpeg", "image/png"
# As in `capture.session.live_view`, a bright line on a wider dark one is visible on any background.
_LINE, _DARK_LINE = (255, 212, 0), (0, 0, 0)
_REGION_LINE = (120, 190, 255)
# Score, in units of the recipe's limit, that has the last colour.
_TOP_SCORE = 2.0
_NO_SCORE = (128, 128, 128)
_LEVELS_12_BIT = 4095
# Size of the cache, for some fifty parts at the small size of pictures, or twelve at the large one.
MAX_CACHE_BYTES = 64 << 20
# Number of parts whose pictures may wait: two browsers request those of a strip of twelve parts.
MAX_WAITING = 24


@dataclass(frozen=True)
class PaintedPicture:
    """A picture of a part."""

    title: str
    caption: str
    media_type: str
    content: bytes


def painted(view: PartView, size: str) -> dict[str, PaintedPicture]:
    """Return the pictures of a part by their API names, each at most `SIZES[size]` px."""
    return dict(_painted(view, SIZES[size], is_large=size == "large"))


def _painted(
    view: PartView, longest_px: int, *, is_large: bool
) -> Iterator[tuple[str, PaintedPicture]]:
    lights = pictures.light_images(view.captured, SHOWN_LIGHTS, longest_px)
    for number, (title, picture) in enumerate(lights.items()):
        yield f"light-{number}", _jpeg(title, "All light images have one scale of grey.", picture)
    albedo = pictures.grey(pictures.reduced(view.albedo, longest_px=longest_px))
    yield "albedo", _jpeg("albedo", "Share of the light that the surface reflects.", albedo)
    normals = pictures.reduced(view.normals, longest_px=longest_px)
    valid = pictures.reduced(view.valid * np.uint8(255), longest_px=longest_px) >= 128
    contrast = pictures.shading_contrast(normals, valid)
    remark = "" if contrast < 1.05 else f" Contrast {contrast:.1f} times that of the shape."
    relief = pictures.shaded(normals, contrast)
    yield "relief", _jpeg("relief", f"The shape alone, lit from the upper left.{remark}", relief)
    shadow = pictures.shadow_colours(len(view.captured.images))[view.shadow_count]
    yield "shadow", _jpeg(
        "shadow", "Lights in shadow: grey none, then from yellow to black all of them.",
        pictures.reduced(shadow, cv2.INTER_NEAREST, longest_px),
    )  # fmt: skip
    colours, description = (
        pictures.normal_map(normals),
        "Red to the right, green up, blue to the camera.",
    )
    yield "normals", _jpeg("normals", description, colours)
    none = "none" if view.score is not None else "no defect map"
    description = f"Outlined defects: {len(view.outlines) or none}; drawn over the albedo."
    yield "defects", _jpeg("defects", description, _outlined(albedo, view))
    if view.score is not None:
        score = _outlined(_score_picture(view.score, longest_px), view)
        description = f"Blue 0, grey 1: the limit, yellow {_TOP_SCORE:g} times the limit and more."
        yield "defect-map", _jpeg("defect map", description, score)
    if is_large:
        yield "slopes", PaintedPicture(
            "slopes", "Normals for programs: x and y from -1 to 1 in 12 bit. Red and green are "
            "their upper 8 bits; blue the lower 4 of x, then those of y.", _PNG,
            pictures.png_bytes(_twelve_bit(normals)),
        )  # fmt: skip


def _jpeg(title: str, caption: str, picture: Picture) -> PaintedPicture:
    return PaintedPicture(title, caption, _JPEG, pictures.jpeg_bytes(picture))


def _outlined(picture: Picture, view: PartView) -> Picture:
    """Return a copy with the outlines of the defects, and of the judged region."""
    drawn = picture.copy()
    scale = picture.shape[1] / view.captured.images.shape[2]
    lines = [(np.array(outline), _LINE) for outline in view.outlines]
    if (region := view.region) is not None:
        right, bottom = region.x + region.width - 1, region.y + region.height - 1
        border = [(region.x, region.y), (right, region.y), (right, bottom), (region.x, bottom)]
        lines.append((np.array(border), _REGION_LINE))
    for width_px, is_dark in ((4, True), (2, False)):
        for corners, colour in lines:
            scaled = np.rint((corners + 0.5) * scale - 0.5).astype(np.int32)
            cv2.polylines(
                drawn, [scaled], True, _DARK_LINE if is_dark else colour, width_px, cv2.LINE_AA
            )
    return drawn


def _score_picture(score: FloatMap, longest_px: int) -> Picture:
    is_scored = np.isfinite(score)
    values = pictures.reduced(np.where(is_scored, score, 0.0), cv2.INTER_NEAREST, longest_px)
    picture = ColourScale(0.0, _TOP_SCORE, _cividis()).paint(values)
    unscored = pictures.reduced(~is_scored * np.uint8(1), cv2.INTER_NEAREST, longest_px) > 0
    picture[unscored] = _NO_SCORE
    return picture


def _cividis() -> Picture:
    """The 256 colours of the map cividis, for people with any colour vision."""
    levels = np.arange(256, dtype=np.uint8)[:, None]
    colours: Picture = cv2.cvtColor(
        cv2.applyColorMap(levels, cv2.COLORMAP_CIVIDIS), cv2.COLOR_BGR2RGB
    )[:, 0].astype(np.uint8, copy=False)
    return colours


def _twelve_bit(normals: FloatMap) -> Picture:
    """Return normals in the form that the caption of ``slopes`` describes."""
    levels = np.rint((normals[..., :2] + 1.0) * (0.5 * _LEVELS_12_BIT))
    x, y = np.moveaxis(np.clip(levels, 0, _LEVELS_12_BIT).astype(np.uint16), 2, 0)
    coded: npt.NDArray[np.uint16] = np.stack([x >> 4, y >> 4, (x & 15) << 4 | y & 15], axis=2)
    return coded.astype(np.uint8)


@dataclass(frozen=True, eq=False)
class PartPictures:
    """All pictures of a part at one size."""

    width_px: int
    height_px: int
    pictures: dict[str, PaintedPicture]
    outlines: tuple[Outline, ...]
    notes: tuple[str, ...]

    @property
    def size_bytes(self) -> int:
        """Size of its files."""
        return sum(len(picture.content) for picture in self.pictures.values())


_Key = tuple[str, str | None, str]


class PictureMaker:
    """Makes pictures of stored parts in a thread; requests for one part share the work."""

    def __init__(self, folder: StationFolder) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._thread = ThreadPoolExecutor(1, "pictures")
        self._waiting: dict[_Key, Future[PartPictures]] = {}
        self._cache: OrderedDict[_Key, PartPictures] = OrderedDict()

    def request(self, result: PartResult, path: Path, size: str) -> Future[PartPictures] | None:
        """Return a future of the pictures of a part; None if too many parts wait already."""
        key = (result.part_id, result.set_sha256, size)
        with self._lock:
            if (pictures := self._cache.get(key)) is not None:
                self._cache.move_to_end(key)
                done: Future[PartPictures] = Future()
                done.set_result(pictures)
                return done
            if (waiting := self._waiting.get(key)) is not None:
                return waiting
            if len(self._waiting) >= MAX_WAITING:
                return None
            future = self._thread.submit(made_pictures, self._folder, result, path, size)
            self._waiting[key] = future
        future.add_done_callback(lambda future: self._store(key, future))
        return future

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(cancel_futures=True)

    def _store(self, key: _Key, future: Future[PartPictures]) -> None:
        with self._lock:
            del self._waiting[key]
            if future.cancelled() or future.exception() is not None:
                return
            self._cache[key] = future.result()
            while sum(pictures.size_bytes for pictures in self._cache.values()) > MAX_CACHE_BYTES:
                self._cache.popitem(last=False)


def made_pictures(folder: StationFolder, result: PartResult, path: Path, size: str) -> PartPictures:
    """Make the pictures of a part."""
    view = part_view(folder, result, path)
    rows, columns = view.captured.images.shape[1:]
    return PartPictures(columns, rows, painted(view, size), view.outlines, view.notes)
