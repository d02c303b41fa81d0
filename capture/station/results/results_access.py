"""`ResultsAccess`: the results of a station, for its panel and for commands beside it."""

import threading

from capture.station.domain.folder import StationFolder
from capture.station.results.database import ResultsUnavailable
from capture.station.results.store import ResultStore, open_store
from classify.base.errors import InputError

# A page that waits longer for a locked database says so.
_PATIENCE_S = 5.0


class ResultsAccess:
    """Opens the results on first use; they may not exist yet."""

    def __init__(self, folder: StationFolder) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._store: ResultStore | None = None

    @property
    def store(self) -> ResultStore:
        """The results."""
        return self._opened(create=False)

    def made(self) -> ResultStore:
        """Return the results, made if there are none and no sets of parts either; see `store`."""
        return self._opened(create=not self._folder.has_sets())

    def _opened(self, *, create: bool) -> ResultStore:
        with self._lock:
            if self._store is None:
                config = self._folder.config
                results = config.results_in(self._folder.path)
                try:
                    self._store = open_store(
                        results, config.name, create=create, alone=False, patience_s=_PATIENCE_S
                    )
                except InputError as error:
                    raise ResultsUnavailable(str(error)) from error
            return self._store

    def close(self) -> None:
        """Close all connections."""
        with self._lock:
            if self._store is not None:
                self._store.close()
                self._store = None
