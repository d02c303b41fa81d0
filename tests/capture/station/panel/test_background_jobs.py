"""Long jobs of the panel: one at a time, in a thread, with a reported end."""

import time
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

import pytest

from capture.base.console import ShowProgress
from capture.station.domain.errors import Conflict
from capture.station.panel.background_jobs import BackgroundJobs, Job
from classify.base.errors import InputError
from tests.waiting import until_so

ABOUT = {"kind": "teach", "recipe": "example", "title": "Teach", "by": "kim"}


def count(show: ShowProgress) -> dict[str, Any]:
    """Count, and say so."""
    return {"counted": list(show(range(3), 3, "count"))}


def wait(show: ShowProgress) -> NoReturn:
    """Never end."""
    for _ in show(iter(int, 1), 1, "wait"):
        time.sleep(0.01)
    raise AssertionError


class Run:
    """Runs jobs, and waits for their ends."""

    def __init__(self, jobs: BackgroundJobs) -> None:
        self.jobs = jobs

    def start(self, work: Callable[[ShowProgress], dict[str, Any]]) -> Job:
        return self.jobs.start(Job(**ABOUT), lambda: work)

    def end(self) -> Job:
        return until_so(
            lambda: (job := self.jobs.last) is not None and job.status != "running" and job
        )


@pytest.fixture
def run() -> Iterator[Run]:
    jobs = BackgroundJobs()
    yield Run(jobs)
    jobs.close()


def test_a_job_ends_with_its_result(run: Run) -> None:
    run.start(count)
    job = run.end()
    assert (job.status, job.step, job.taken, job.total) == ("done", "count", 3, 3)
    assert job.result == {"counted": [0, 1, 2]}
    assert run.jobs.last == job


def test_a_second_job_is_refused_and_a_running_one_can_be_ended(run: Run) -> None:
    job = run.start(wait)
    with pytest.raises(Conflict, match="Teach: is running; wait for its end"):
        run.start(count)
    assert run.jobs.last is not None
    assert run.jobs.last.id == job.id
    run.jobs.cancel("ada")
    assert run.end().error == "ended by ada"
    run.jobs.cancel("ada")  # of nothing
    run.jobs.close()
    with pytest.raises(Conflict, match="the panel ends"):
        run.start(count)


@pytest.mark.parametrize(
    ("raised", "error"),
    [
        (InputError("there is no such part"), "there is no such part"),
        (ValueError("a defect"), "ValueError: a defect"),
    ],
)
def test_a_job_that_fails_says_why(run: Run, raised: Exception, error: str) -> None:
    def fail(_: ShowProgress) -> NoReturn:
        raise raised

    run.start(fail)
    job = run.end()
    assert (job.status, job.error) == ("failed", error)


def test_a_job_that_takes_too_long_is_ended() -> None:
    run = Run(BackgroundJobs(max_s=0.1))
    run.start(wait)
    assert run.end().error == "took longer than 0.1 s; choose fewer parts"


def test_the_end_of_the_panel_ends_its_job(run: Run) -> None:
    run.start(wait)
    run.jobs.close()
    assert run.end().error == "the panel ended"
