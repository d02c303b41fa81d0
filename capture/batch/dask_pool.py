"""Workers of a Dask cluster."""

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import Executor, Future
from importlib import metadata
from typing import TypeVar

from classify.base.errors import InputError

from .local_pool import call_in_one_thread

# Minimum number of submitted items, for workers that join later. They take little memory, because
# an item is a path.
_MIN_IN_FLIGHT = 256

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


async def _check_scheduler(address: str, answer_s: float) -> None:
    """Connect to the scheduler and disconnect."""
    # A `Client` waits for ever for a server that does not answer, and the thread of a failed
    # `Client` can stop the next one.
    from distributed.comm.core import connect
    from distributed.security import Security

    async with asyncio.timeout(answer_s):
        security = Security().get_connection_args("client")
        await (await connect(address, timeout=answer_s, **security)).close()


class DaskPool:
    """Workers of a Dask scheduler, which may join later, used like a `LocalPool`."""

    # The scheduler itself gives the items of a dead worker to others, and counts the failures, up
    # to `distributed.scheduler.allowed-failures`.
    attempts = 1
    workers = 1

    def __init__(self, address: str, *, version: str | None = None, answer_s: float = 10.0) -> None:
        try:
            from distributed import Client, KilledWorker
        except ImportError as error:
            raise InputError(
                f"--scheduler {address}: Dask is not installed; pip install 'ps4rig[dask]'"
            ) from error
        # Silences Dask's log of lost connections, which the error line of the command repeats.
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            asyncio.run(_check_scheduler(address, answer_s))
            self._client = Client(address, timeout=answer_s, set_as_default=False)
        # Exception: Dask raises many kinds of errors on the answers of other servers.
        except Exception as error:
            cause = str(error) or f"no greeting within {answer_s:g} s"
            raise InputError(
                f"--scheduler {address}: no Dask scheduler answers ({cause}); "
                "give its address, such as tcp://HOST:8786"
            ) from error
        try:
            self._check_versions(version or metadata.version("ps4rig"))
        except InputError:
            self._client.close()
            raise
        self.death_types: tuple[type[Exception], ...] = (KilledWorker,)
        self.in_flight = max(_MIN_IN_FLIGHT, 4 * sum(self._client.nthreads().values()))
        self._executor: Executor = self._client.get_executor(pure=False)

    def _check_versions(self, version: str) -> None:
        # A worker without this package ends at its first item without a message.
        answers = self._client.run(metadata.version, "ps4rig", on_error="return")
        for worker, answer in answers.items():
            # OSError: the worker has just left the cluster.
            if answer != version and not isinstance(answer, OSError):
                installed = f"ps4rig {answer}" if isinstance(answer, str) else "no ps4rig"
                raise InputError(
                    f"worker {worker} has {installed}, this is ps4rig {version}; install the same "
                    "version on all machines"
                )

    def submit(self, function: Callable[[_Item], _Result], item: _Item) -> Future[_Result]:
        return self._executor.submit(call_in_one_thread, function, item)

    def renew(self) -> None:
        """Do nothing: the scheduler replaces dead workers."""

    def close(self) -> None:
        self._client.close()

    def abort(self) -> None:
        """Cancel the items that have not started; the results of running items are ignored."""
        self._executor.shutdown(wait=False)
        self._client.close()
