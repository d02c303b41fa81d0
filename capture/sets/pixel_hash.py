"""`PixelHash`: the SHA-256 of the pixels of a set, computed while its images arrive."""

import hashlib
import threading
from collections import deque
from collections.abc import Callable

from classify.base.threads import beside
from rig.set_file import Planes, hash_page


class PixelHash:
    """SHA-256 of the pages of a set, which may arrive in any order; see `pixels_sha256`.

    One task hashes all pages that are due; tasks that wait for each other could deadlock.
    """

    def __init__(self) -> None:
        self._digest = hashlib.sha256()
        self._waiting: dict[int, Planes] = {}  # pages that come before their turn
        self._next = 0
        # Shared with the thread that hashes.
        self._lock = threading.Lock()
        self._due: deque[Planes] = deque()
        self._is_hashing = False
        self._hashed: Callable[[], None] = lambda: None  # waits for that thread

    def add(self, page: int, plane: Planes) -> None:
        """Add a page that is not there yet; return at once."""
        if self.has(page):
            raise ValueError(f"page {page} is added a second time")
        self._waiting[page] = plane
        with self._lock:
            while self._next in self._waiting:
                self._due.append(self._waiting.pop(self._next))
                self._next += 1
            begins = bool(self._due) and not self._is_hashing
            self._is_hashing |= begins
        if begins:
            self._hashed = beside(self._hash_due)

    def has(self, page: int) -> bool:
        """Whether a page was added."""
        return page < self._next or page in self._waiting

    def sha256(self) -> str:
        """Wait for all pages and return the hash; ValueError if one before the last is missing."""
        if self._waiting:
            raise ValueError(f"page {self._next} is missing")
        hashed, self._hashed = self._hashed, lambda: None
        hashed()
        return self._digest.hexdigest()

    def _hash_due(self) -> None:
        while True:
            with self._lock:
                if not self._due:
                    self._is_hashing = False
                    return
                plane = self._due.popleft()
            hash_page(self._digest, plane)
