"""`BackgroundJobs`: one long job at a time, in a thread."""

import logging
import secrets
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

from capture.base.console import ShowProgress
from capture.base.utc_time import utc_text
from capture.station.domain.errors import Conflict, error_text
from classify.base.errors import Ps4rigError

_log = logging.getLogger(__name__)
# Teaching takes a second of processor time for each part of 1024 x 1024 px: 300 parts, if a busy
# line leaves a job a tenth of a processor.
_MAX_JOB_S = 3600.0

_T = TypeVar("_T")
Work = Callable[[ShowProgress], dict[str, Any]]
"""Does a job, and reports the items that it works through."""


class _JobCancelled(Ps4rigError):  # noqa: N818 - requested, no error of the program
    """The job was cancelled, or takes too long."""


@dataclass(frozen=True)
class Job:
    """A job at one moment."""

    kind: str  # ``teach`` or ``challenge``
    recipe: str
    title: str  # what it does, for people
    by: str
    id: str = field(default_factory=lambda: secrets.token_hex(4))
    started_utc: str = field(default_factory=utc_text)
    status: Literal["running", "done", "failed"] = "running"
    step: str = "starting"
    taken: int = 0  # items of the present step that are done
    total: int = 0
    error: str = ""
    result: dict[str, Any] = field(default_factory=dict)


class BackgroundJobs:
    """Runs one job at a time, for at most `max_s`, and remembers the last one."""

    def __init__(self, max_s: float = _MAX_JOB_S) -> None:
        self._max_s = max_s
        self._lock = threading.Lock()
        self._job: Job | None = None
        self._cancel_reason = ""  # why the running job must end
        self._is_closed = False
        self._thread = ThreadPoolExecutor(1, "job")

    @property
    def last(self) -> Job | None:
        """The running job, or the last one; None before the first."""
        with self._lock:
            return self._job

    def start(self, job: Job, begin: Callable[[], Work]) -> Job:
        """Start a job whose work `begin` returns; an exception of `begin` leaves the last job.

        Raises Conflict if a job is running, or the panel ends.
        """
        with self._lock:
            if self._is_closed:
                raise Conflict("the panel ends")
            if self._job is not None and self._job.status == "running":
                raise Conflict(f"{self._job.title}: is running; wait for its end, or end it")
            before, self._job, self._cancel_reason = self._job, job, ""
        try:
            self._thread.submit(self._run, begin())
        except BaseException:
            with self._lock:
                self._job = before
            raise
        return job

    def cancel(self, by: str) -> None:
        """End the running job, if there is one."""
        with self._lock:
            self._cancel_reason = self._cancel_reason or f"ended by {by}"

    def close(self) -> None:
        """End the running job, and start no further one."""
        with self._lock:
            self._is_closed = True
            self._cancel_reason = self._cancel_reason or "the panel ended"
        self._thread.shutdown()

    def _run(self, work: Work) -> None:
        deadline_s = time.monotonic() + self._max_s

        def show(items: Iterable[_T], total: int, description: str) -> Iterator[_T]:
            self._change(step=description, taken=0, total=total)
            for done, item in enumerate(items, start=1):
                if time.monotonic() > deadline_s:
                    raise _JobCancelled(f"took longer than {self._max_s:g} s; choose fewer parts")
                if self._cancel_reason:
                    raise _JobCancelled(self._cancel_reason)
                yield item
                self._change(taken=done)

        try:
            end: dict[str, Any] = {"status": "done", "result": work(show)}
        except BaseException as error:
            if not isinstance(error, Ps4rigError):
                _log.exception("the job failed")
            end = {"status": "failed", "error": error_text(error)}
        self._change(**end)

    def _change(self, **changes: Any) -> None:
        with self._lock:
            assert self._job is not None
            self._job = replace(self._job, **changes)
