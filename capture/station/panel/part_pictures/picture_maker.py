"""`PictureMaker`: pictures of stored parts, made part by part, kept for a while."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from capture.batch.local_pool import LocalPool
from capture.station.domain.folder import StationFolder
from capture.station.results.part_result import PartResult

from .painting import PaintedPicture, painted
from .part_view import Outline, part_view

# The pictures of some fifty parts at the small size, or of twelve at the large one.
KEPT_BYTES = 64 << 20
# Number of parts whose pictures may wait: the twelve of the strip in two browsers.
MOST_WAITING = 24


@dataclass(frozen=True)
class PictureTask:
    """Pictures of a part to be made; its attributes are those of `PictureMaker.ask`."""

    folder: StationFolder
    result: PartResult
    path: Path
    size: str


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


class PictureWorker(Protocol):
    """Makes pictures, one part after the other; see `LocalPool`."""

    def submit(
        self, function: Callable[[PictureTask], PartPictures], item: PictureTask
    ) -> Future[PartPictures]:
        """Have the pictures of a part made."""

    def abort(self) -> None:
        """End at once."""


def _yielding_process() -> PictureWorker:
    return LocalPool(1, yields=True)


class PictureMaker:
    """Has pictures of stored parts made in another process, which yields to the station.

    Pictures that cannot wait are made in a thread of this process.
    """

    def __init__(
        self, folder: StationFolder, start: Callable[[], PictureWorker] = _yielding_process
    ) -> None:
        self._folder, self._start = folder, start
        self._lock = threading.Lock()
        self._worker: PictureWorker | None = None
        self._is_closed = False
        self._thread = ThreadPoolExecutor(1, "pictures")
        self._waiting: dict[tuple[_Key, bool], Future[PartPictures]] = {}
        self._kept: OrderedDict[_Key, PartPictures] = OrderedDict()

    def ask(
        self, result: PartResult, path: Path, size: str, *, waits: bool = True
    ) -> Future[PartPictures] | None:
        """Return a future of the pictures of a part; None if too many parts wait already.

        It raises `BrokenExecutor` if the process dies, and is cancelled if the
        pictures were made for somebody who could not wait.
        """
        key = (result.part_id, result.set_sha256, size)
        with self._lock:
            if (pictures := self._kept.get(key)) is not None:
                self._kept.move_to_end(key)
                done: Future[PartPictures] = Future()
                done.set_result(pictures)
                return done
            if (waiting := self._waiting.get((key, waits))) is not None:
                return waiting
            if self._is_closed or len(self._waiting) >= MOST_WAITING:
                return None
            task = PictureTask(self._folder, result, path, size)
            future = self._submitted(task) if waits else self._thread.submit(made_pictures, task)
            self._waiting[key, waits] = future
        future.add_done_callback(lambda made: self._keep(key, waits, made))
        return future

    def close(self) -> None:
        """End process and thread."""
        with self._lock:
            self._is_closed = True
            worker, self._worker = self._worker, None
        if worker is not None:
            worker.abort()
        self._thread.shutdown(cancel_futures=True)

    def _submitted(self, task: PictureTask) -> Future[PartPictures]:
        if self._worker is None:
            self._worker = self._start()
        try:
            return self._worker.submit(made_pictures, task)
        except BrokenExecutor:
            # `abort` waits until all futures are done; their callbacks need the lock held here.
            self._thread.submit(self._worker.abort)
            self._worker = self._start()
            return self._worker.submit(made_pictures, task)

    def _keep(self, key: _Key, waits: bool, made: Future[PartPictures]) -> None:
        with self._lock:
            del self._waiting[key, waits]
            if made.cancelled() or made.exception() is not None:
                return
            self._kept[key] = made.result()
            while sum(pictures.size_bytes for pictures in self._kept.values()) > KEPT_BYTES:
                self._kept.popitem(last=False)
            late = None if waits else self._waiting.get((key, True))
        if late is not None:
            late.cancel()  # its place is for another part


def made_pictures(task: PictureTask) -> PartPictures:
    """Make the pictures of a part."""
    view = part_view(task.folder, task.result, task.path)
    rows, columns = view.captured.images.shape[1:]
    return PartPictures(columns, rows, painted(view, task.size), view.outlines, view.notes)
