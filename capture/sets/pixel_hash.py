"""`PixelHash`: the SHA-256 of the pixels of a set, computed while its images arrive."""

import hashlib
from collections.abc import Callable
from functools import partial

from classify.threads import beside
from rig.set_file import Planes, hash_page


class PixelHash:
    """SHA-256 of the pages of a set, which may arrive in any order; see `pixels_sha256`.

    A page is hashed in another thread as soon as all pages before it have arrived.
    """

    def __init__(self) -> None:
        self._digest = hashlib.sha256()
        self._waiting: dict[int, Planes] = {}  # pages that come before their turn
        self._next = 0
        # Waits until the last page that was begun is hashed; called once, for the next page.
        self._hashed: Callable[[], None] = lambda: None

    def add(self, page: int, plane: Planes) -> None:
        """Add a page; return at once.

        Raises
        ------
        ValueError
            If the page is there already.
        """
        if self.has(page):
            raise ValueError(f"page {page} is added a second time")
        self._waiting[page] = plane
        while self._next in self._waiting:
            due = self._waiting.pop(self._next)
            self._next += 1
            self._hashed = beside(partial(self._hash, self._hashed, due))

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

    def _hash(self, before: Callable[[], None], plane: Planes) -> None:
        before()
        hash_page(self._digest, plane)
