"""`PictureMaker`: pictures of stored parts, made one part at a time, and kept for a while."""

import threading
import time
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from capture.station.folder import StationFolder
from capture.station.live.live_station import LiveStation
from capture.station.results.part_result import PartResult

from .painting import PaintedPicture, painted
from .part_view import Outline, part_view

# The pictures of some fifty parts at the small size, or of twelve at the large one.
KEPT_BYTES = 64 << 20
# Parts that are asked for and not made yet: the twelve of the strip, of two browsers.
MOST_WAITING = 24
# Making pictures waits so long for a moment without a part in the station: longer than an
# inspection, so that only a line that never pauses shares its processors.
PATIENCE_S = 1.0
_POLL_S = 0.01


@dataclass(frozen=True, eq=False)
class PartPictures:
    """All pictures of a part at one size.

    Attributes
    ----------
    width_px, height_px
        Size of its light images.
    pictures
        By name.
    outlines, notes
        As in `PartView`.
    """

    width_px: int
    height_px: int
    pictures: dict[str, PaintedPicture]
    outlines: tuple[Outline, ...]
    notes: tuple[str, ...]

    @property
    def size_bytes(self) -> int:
        """Size of its files."""
        return sum(len(each.content) for each in self.pictures.values())


_Key = tuple[str, str | None, str]


class PictureMaker:
    """Makes pictures of stored parts in one thread, so that the station is never delayed by more.

    Parameters
    ----------
    folder
        The station.
    live
        The running station, whose parts have precedence.
    """

    def __init__(self, folder: StationFolder, live: LiveStation) -> None:
        self._folder, self._live = folder, live
        self._lock = threading.Lock()
        self._thread = ThreadPoolExecutor(1, "pictures")
        self._waiting: dict[_Key, Future[PartPictures]] = {}
        self._kept: OrderedDict[_Key, PartPictures] = OrderedDict()

    def ask(self, result: PartResult, path: Path, size: str) -> Future[PartPictures] | None:
        """Return the pictures of a part, in future; None if `MOST_WAITING` parts wait already.

        Parameters
        ----------
        path
            Its stored set.
        size
            A name of `SIZES`.
        """
        key = (result.part_id, result.set_sha256, size)
        with self._lock:
            if (kept := self._kept.get(key)) is not None:
                self._kept.move_to_end(key)
                done: Future[PartPictures] = Future()
                done.set_result(kept)
                return done
            if (waiting := self._waiting.get(key)) is not None:
                return waiting
            if len(self._waiting) >= MOST_WAITING:
                return None
            future = self._thread.submit(self._made, key, result, path)
            self._waiting[key] = future
        future.add_done_callback(lambda _: self._forget(key))
        return future

    def close(self) -> None:
        """End the thread after the part that it works on."""
        self._thread.shutdown(cancel_futures=True)

    def _forget(self, key: _Key) -> None:
        with self._lock:
            self._waiting.pop(key, None)

    def _made(self, key: _Key, result: PartResult, path: Path) -> PartPictures:
        ends_s = time.monotonic() + PATIENCE_S
        while self._live.parts_in_progress > 0 and time.monotonic() < ends_s:
            time.sleep(_POLL_S)
        view = part_view(self._folder, result, path)
        rows, columns = view.captured.images.shape[1:]
        made = PartPictures(columns, rows, painted(view, key[2]), view.outlines, view.notes)
        with self._lock:
            self._kept[key] = made
            while sum(each.size_bytes for each in self._kept.values()) > KEPT_BYTES:
                self._kept.popitem(last=False)
        return made
