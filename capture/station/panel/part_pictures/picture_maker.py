"""`PictureMaker`: pictures of stored parts, made in a thread and cached."""

import threading
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from capture.station.domain.folder import StationFolder
from capture.station.results.part_result import PartResult

from .painting import PaintedPicture, painted
from .part_view import Outline, part_view

# Size of the cache, for some fifty parts at the small size of pictures, or twelve at the large one.
MAX_CACHE_BYTES = 64 << 20
# Number of parts whose pictures may wait: two browsers request those of a strip of twelve parts.
MAX_WAITING = 24


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
