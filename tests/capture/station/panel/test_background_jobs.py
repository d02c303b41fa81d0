"""Long jobs of the panel: one at a time, in a thread, with a reported end."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from capture.station.domain.errors import Conflict
from capture.station.panel.background_jobs import BackgroundJobs, Job
from tests.capture.station.panel import quick_jobs
from tests.capture.station.panel.panels import WAIT_S

ABOUT = {"kind": "teach", "recipe": "example", "title": "Teach", "by": "kim"}


class Run:
    """Runs jobs, and waits for their ends."""

    def __init__(self, jobs: BackgroundJobs) -> None:
        self.jobs = jobs

    def start(self, work: Callable[..., dict[str, Any]], *arguments: Any) -> Job:
        return self.jobs.start(Job(**ABOUT), lambda: lambda show: work(show, *arguments))

    def end(self) -> Job:
        ends_s = time.monotonic() + WAIT_S
        while (job := self.jobs.last) is None or job.status == "running":
            assert time.monotonic() < ends_s
            time.sleep(0.01)
        return job


@pytest.fixture
def run() -> Iterator[Run]:
    jobs = BackgroundJobs()
    yield Run(jobs)
    jobs.close()


def test_a_job_ends_with_its_result(run: Run) -> None:
    run.start(quick_jobs.count, 3)
    job = run.end()
    assert (job.status, job.step, job.taken, job.total) == ("done", "count", 3, 3)
    assert job.result == {"counted": [0, 1, 2]}
    assert run.jobs.last == job


def test_a_second_job_is_refused_and_a_running_one_can_be_ended(run: Run) -> None:
    job = run.start(quick_jobs.wait)
    with pytest.raises(Conflict, match="Teach: is running; wait for its end"):
        run.start(quick_jobs.count, 1)
    assert run.jobs.last is not None
    assert run.jobs.last.id == job.id
    run.jobs.cancel("ada")
    assert run.end().error == "ended by ada"
    run.jobs.cancel("ada")  # of nothing
    run.jobs.close()
    with pytest.raises(Conflict, match="the panel ends"):
        run.start(quick_jobs.count, 1)


@pytest.mark.parametrize(
    ("work", "arguments", "error"),
    [
        (quick_jobs.fail, (True,), "there is no such part"),
        (quick_jobs.fail, (False,), "ValueError: a defect"),
    ],
    ids=["refused", "a defect"],
)
def test_a_job_that_fails_says_why(
    run: Run, work: Callable[..., dict[str, Any]], arguments: tuple[Any, ...], error: str
) -> None:
    run.start(work, *arguments)
    job = run.end()
    assert (job.status, job.error) == ("failed", error)


def test_a_job_that_takes_too_long_is_ended() -> None:
    run = Run(BackgroundJobs(most_s=0.1))
    run.start(quick_jobs.wait)
    assert run.end().error == "took longer than 0.1 s; choose fewer parts"


def test_the_end_of_the_panel_ends_its_job(run: Run) -> None:
    run.start(quick_jobs.wait)
    run.jobs.close()
    assert run.end().error == "the panel ended"
