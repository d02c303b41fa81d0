"""Workers of a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Executor, Future
from importlib import metadata
from typing import TypeVar

from classify.errors import InputError

from .one_thread import call_in_one_thread

__all__ = ["DaskPool"]

_VERSION = metadata.version("ps4rig")
_ANSWER_S = 10.0
_LEAST_IN_FLIGHT = 256

Item = TypeVar("Item")
Result = TypeVar("Result")


class DaskPool:
    """A `batch.Pool` of the workers that a Dask scheduler has, or gets while the work goes on.

    The scheduler runs the items of a dead worker again, on another.

    Raises
    ------
    InputError
        If no scheduler answers at the address, Dask is not installed, or a worker has not this
        version of ps4rig.
    """

    # The scheduler has counted: it gives an item up after `distributed.scheduler.allowed-failures`.
    attempts = 1
    workers = 1

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client, KilledWorker
        except ImportError as error:
            raise InputError(
                f"--scheduler {address}: Dask is not installed; pip install 'ps4rig[dask]'"
            ) from error
        # What it says about lost connections is said once, by the error line.
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler {address}: no Dask scheduler answers ({error}); "
                "give its address, as tcp://HOST:8786"
            ) from error
        try:
            self._check_versions()
        except InputError:
            self._client.close()
            raise
        self.died: tuple[type[Exception], ...] = (KilledWorker,)
        self.in_flight = max(_LEAST_IN_FLIGHT, 4 * sum(self._client.nthreads().values()))
        self._executor: Executor = self._client.get_executor(pure=False)

    def _check_versions(self) -> None:
        # A worker without this package does not say so but ends, at the first item.
        answers = self._client.run(metadata.version, "ps4rig", on_error="return")
        for worker, found in answers.items():
            if found != _VERSION and not isinstance(found, OSError):  # which is: it has just gone
                told = f"ps4rig {found}" if isinstance(found, str) else "no ps4rig"
                raise InputError(
                    f"worker {worker} has {told}, this is ps4rig {_VERSION}; install the same "
                    "version on all machines"
                )

    def submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        """Have a worker call the function."""
        return self._executor.submit(call_in_one_thread, function, item)

    def renew(self) -> None:
        """Nothing to do: workers come and go, and the scheduler knows."""

    def close(self) -> None:
        """Let the workers go; they have nothing to do."""
        self._client.close()

    def abort(self) -> None:
        """Cancel what has not begun. What a worker is at, it ends; nobody asks for it."""
        self._executor.shutdown(wait=False)
        self._client.close()
