"""`ResultsAccess`: the results of a running station for its panel."""

import threading

from capture.station.folder import StationFolder
from capture.station.results.database import ResultsUnavailable
from capture.station.results.store import ResultStore, open_store
from classify.errors import InputError

# A page that waits longer for a locked database says so.
_PATIENCE_S = 5.0


class NoResultsYet(ResultsUnavailable):
    """The station has not run yet."""


class ResultsAccess:
    """Opens the results when they are asked for first: the run makes them at its start.

    Parameters
    ----------
    folder
        The station.
    """

    def __init__(self, folder: StationFolder) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._store: ResultStore | None = None

    @property
    def store(self) -> ResultStore:
        """The results.

        Raises
        ------
        NoResultsYet
            Before the first run.
        ResultsUnavailable
            If the database does not answer.
        """
        with self._lock:
            if self._store is None:
                config = self._folder.config
                results = config.results_in(self._folder.path)
                try:
                    self._store = open_store(
                        results, config.name, alone=False, patience_s=_PATIENCE_S
                    )
                except InputError as error:
                    raise NoResultsYet(f"there are no results yet: {error}") from error
            return self._store

    def close(self) -> None:
        """Close all connections."""
        with self._lock:
            if self._store is not None:
                self._store.close()
                self._store = None
