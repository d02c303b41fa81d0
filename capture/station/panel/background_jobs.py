"""`BackgroundJobs`: one long job at a time, in a process of low priority."""

import json
import logging
import os
import secrets
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Literal, TypeVar

from capture.base.console import ShowProgress
from capture.base.utc_time import utc_text
from capture.batch.local_pool import (
    at_work,
    begin_worker,
    call_in_one_thread,
    terminal_signals_blocked,
)
from capture.station.domain.errors import error_text
from classify.base.errors import Ps4rigError

_log = logging.getLogger(__name__)
# Teaching takes a second of processor time for each part of 1024 x 1024 px: 300 parts, if a busy
# line leaves a job a tenth of a processor.
MOST_S = 3600.0
_POLL_S = 0.2
# For an ended process to remove its temporary files.
_END_S = 5.0
_LOWEST_PRIORITY = 19

T = TypeVar("T")
Work = Callable[..., dict[str, Any]]
"""A function of a module, called with a `ShowProgress` and its arguments in the other process."""


class JobRefused(Ps4rigError):  # noqa: N818 - the state of the station, no error of the program
    """A job is running already, or the station ends."""


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
    """Runs one job at a time, for at most `most_s`, and remembers the last one.

    The process has one thread and, where the system knows that, the lowest priority.
    """

    def __init__(self, most_s: float = MOST_S) -> None:
        self._most_s = most_s
        self._lock = threading.Lock()
        self._job: Job | None = None
        self._ending = ""  # why the running job must end
        self._is_closed = False
        self._thread: threading.Thread | None = None

    @property
    def last(self) -> Job | None:
        """The running job, or the last one; None before the first."""
        with self._lock:
            return self._job

    def require_free(self) -> None:
        """Check that a job could be started."""
        with self._lock:
            self._require_free()

    def start(
        self, job: Job, work: Work, arguments: tuple[Any, ...], ended: Callable[[Job], None]
    ) -> Job:
        """Start a job; `ended` is called with it in another thread, before it counts as ended."""
        with self._lock:
            self._require_free()
            self._job, self._ending = job, ""
            self._thread = threading.Thread(
                target=self._follow, args=(work, arguments, ended), name="job", daemon=True
            )
            self._thread.start()
        return job

    def cancel(self, by: str) -> None:
        """End the running job, if there is one."""
        with self._lock:
            self._ending = self._ending or f"ended by {by}"

    def close(self) -> None:
        """End the running job, and start none any more."""
        with self._lock:
            self._is_closed = True
            self._ending = self._ending or "the station ended"
            thread = self._thread
        if thread is not None:
            thread.join()

    def _require_free(self) -> None:
        if self._is_closed:
            raise JobRefused("the station ends")
        if self._job is not None and self._job.status == "running":
            raise JobRefused(f"{self._job.title}: is running; wait for its end, or end it")

    def _follow(self, work: Work, arguments: tuple[Any, ...], ended: Callable[[Job], None]) -> None:
        try:
            changes = self._outcome(work, arguments)
        except Exception as error:
            _log.exception("a job failed")
            changes = {"error": error_text(error)}
        changes["status"] = "failed" if changes.get("error") else "done"
        with self._lock:
            assert self._job is not None
            job = replace(self._job, **changes)
        try:
            ended(job)
        except Exception:
            _log.exception("after the job %s", job.title)
        # Last, because a reader that sees the job as ended looks for what `ended` wrote.
        with self._lock:
            self._job = job

    def _outcome(self, work: Work, arguments: tuple[Any, ...]) -> dict[str, Any]:
        """Run the job in another process; return its result or the reason of its failure."""
        context = get_context("spawn")
        far_end, lifeline = context.Pipe(duplex=False)
        reports, reporter = context.Pipe(duplex=False)
        process = context.Process(
            target=_work, args=(far_end, reporter, work, arguments), name="job", daemon=True
        )
        ends_s = time.monotonic() + self._most_s
        try:
            try:
                with terminal_signals_blocked():
                    process.start()
            finally:
                far_end.close()
                reporter.close()
            while not (ending := self._why_end(ends_s)):
                if not reports.poll(_POLL_S):
                    continue
                try:
                    report = json.loads(reports.recv_bytes())
                except EOFError:
                    process.join(_END_S)
                    return {"error": f"its process ended (status {process.exitcode})"}
                if "step" not in report:
                    return dict(report)
                self._change(**report)
            return {"error": ending}
        finally:
            lifeline.close()
            if process.pid is not None:
                process.join(_END_S)
                if process.is_alive():
                    process.kill()
                    process.join()
            reports.close()

    def _why_end(self, ends_s: float) -> str:
        with self._lock:
            if self._ending:
                return self._ending
        late = f"took longer than {self._most_s:g} s; choose fewer parts"
        return late if time.monotonic() > ends_s else ""

    def _change(self, **changes: Any) -> None:
        with self._lock:
            assert self._job is not None
            self._job = replace(self._job, **changes)


def _work(
    lifeline: Connection, reporter: Connection, work: Work, arguments: tuple[Any, ...]
) -> None:
    """Do a job in this process, and report to the other one."""
    begin_worker(lifeline)
    at_work.set()
    if hasattr(os, "setpriority"):
        os.setpriority(os.PRIO_PROCESS, 0, _LOWEST_PRIORITY)

    def report(**fields: Any) -> None:
        reporter.send_bytes(json.dumps(fields).encode())

    def show(items: Iterable[T], total: int, description: str) -> Iterator[T]:
        done = 0
        report(step=description, taken=done, total=total)
        for item in items:
            yield item
            done += 1
            report(step=description, taken=done, total=total)

    def run(show: ShowProgress) -> dict[str, Any]:
        return work(show, *arguments)

    try:
        result = call_in_one_thread(run, show)
    except Exception as error:
        if not isinstance(error, Ps4rigError):
            _log.exception("the job failed")
        report(error=error_text(error))
    else:
        report(result=result)
