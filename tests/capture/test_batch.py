"""Batches in this process, in worker processes and on a Dask cluster; workers that are killed."""

import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import Any

import pytest

from capture.batch.dask_pool import DaskPool
from capture.batch.runner import Batch
from capture.batch.tasks import SolveTask, classify_set, read_header, solve_set
from capture.batch.training import train_library
from classify import InputError
from tests.waiting import until_so

Command = Callable[..., Any]
DEADLINE_S = 300.0
KILL = int(signal.SIGKILL)
SELF = "/proc/self"  # a link to the number of the process that reads it

# Most of these tests start and kill processes.
pytestmark = pytest.mark.slow


class Cluster:
    """A scheduler and two workers, each in its own process."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._workers: dict[str, subprocess.Popen[bytes]] = {}
        described = folder / "scheduler.json"
        self._scheduler = self._start("scheduler", "--port=0", f"--scheduler-file={described}")
        self.address: str = until_so(lambda: described.exists() and described.read_text())
        self.address = json.loads(self.address)["address"]

    def with_two_workers(self) -> str:
        """Replace dead workers; return the address once two workers are alive."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            until_so(lambda: self._has_two_workers(client.scheduler_info()["workers"]))
        return self.address

    def _has_two_workers(self, known: Mapping[str, Any]) -> bool:
        """Replace dead workers; return whether the scheduler knows just the two living ones.

        A killed worker is not dead at once, nor forgotten.
        """
        for name, worker in list(self._workers.items()):
            if worker.poll() is not None:
                del self._workers[name]
        while len(self._workers) < 2:
            name = f"worker-{time.monotonic_ns()}"
            # A worker has two threads, of which only one may run an item at a time.
            options = ("--nthreads=2", "--no-nanny", f"--local-directory={self._folder}")
            self._workers[name] = self._start("worker", self.address, f"--name={name}", *options)
        return {about["name"] for about in known.values()} == self._workers.keys()

    def stop(self) -> None:
        for process in (*self._workers.values(), self._scheduler):
            process.kill()
            process.wait()

    def _start(self, kind: str, *options: str) -> subprocess.Popen[bytes]:
        module = f"distributed.cli.dask_{kind}"
        environment = {
            "PYTHONPATH": os.pathsep.join(sys.path),
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
        }
        return subprocess.Popen(
            [sys.executable, "-m", module, "--host=127.0.0.1", "--no-dashboard", *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | environment,
        )


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    pytest.importorskip("distributed")
    started = Cluster(tmp_path_factory.mktemp("cluster"))
    yield started
    started.stop()


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Twenty files, each containing its number."""
    paths = [tmp_path / f"file{number:02d}" for number in range(20)]
    for number, path in enumerate(paths):
        path.write_text(str(number))
    return paths


class Trap:
    """A named pipe in place of a file: a process that reads the file waits."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.with_suffix(".file")
        path.rename(self._file)
        os.mkfifo(path)

    def caught(self) -> tuple[int, int]:
        """Return a waiting process, and the open end of the pipe that keeps it waiting."""
        writing = until_so(self._writing)
        return until_so(self._reader), writing

    def kill_one(self) -> None:
        """Kill the waiting process; the next reader finds the file."""
        reader, writing = self.caught()
        self._file.rename(self._path)
        os.kill(reader, signal.SIGKILL)
        os.close(writing)

    def _writing(self) -> int | None:
        try:
            return os.open(self._path, os.O_WRONLY | os.O_NONBLOCK)
        except OSError:  # no reader yet
            return None

    def _reader(self) -> int | None:
        for link in Path("/proc").glob("[0-9]*/fd/*"):
            process = int(link.parts[2])
            try:
                if link.readlink() == self._path and process != os.getpid():
                    return process
            except OSError:
                continue
        return None


def workers() -> set[int]:
    return {process.pid or 0 for process in multiprocessing.active_children()}


@pytest.fixture(scope="module")
def two_workers() -> Iterator[Batch]:
    """A batch on two processes, shared by the tests that do not end it."""
    with Batch(2, start_up_s=0.0) as run:
        yield run


# places and order


@pytest.mark.parametrize("options", [{}, {"workers": 1, "start_up_s": 0.0}])
def test_short_work_and_one_worker_run_in_this_process(options: dict[str, Any]) -> None:
    with Batch(**options) as run:
        assert list(run.map(os.readlink, [SELF] * 9)) == [str(os.getpid())] * 9


def test_longer_work_continues_in_other_processes_which_end_with_the_batch() -> None:
    before = workers()
    with Batch(workers=2, start_up_s=1e-9) as run:
        first, *rest = run.map(os.readlink, [SELF] * 9)
        assert first == str(os.getpid())
        started = workers() - before
        assert 1 <= len(started) <= 2
        assert set(map(int, rest)) <= started
        # A second map uses the same processes.
        assert set(map(int, run.map(os.readlink, [SELF] * 9))) <= started
    assert workers() == before


def test_many_sets_start_the_workers_with_the_batch() -> None:
    before = workers()
    with Batch(workers=2, sets=1000) as run:
        started = workers() - before
        assert len(started) == 2
        first, *rest = run.map(os.readlink, [SELF] * 9)
        assert first == str(os.getpid())
        assert set(map(int, rest)) <= started


def test_results_are_in_order_and_no_more_items_are_read_than_needed(two_workers: Batch) -> None:
    items = count()
    results = two_workers.map(str, items)
    assert list(islice(results, 100)) == list(map(str, range(100)))
    assert next(items) <= 100 + 4 * 2


def test_an_error_is_raised_in_the_place_of_its_result(two_workers: Batch, sets: Path) -> None:
    good = sets / "rock-001.ome.tif"
    results = two_workers.map(read_header, [good, good, sets / "none.ome.tif", good])
    assert [next(results).label, next(results).label] == ["rock", "rock"]
    with pytest.raises(InputError, match=r"none\.ome\.tif: no such file$"):
        next(results)


# workers that are killed


@pytest.fixture(params=["local", "dask"])
def batch(request: pytest.FixtureRequest) -> Iterator[Batch]:
    """A batch on two worker processes and on two workers of a cluster."""
    if request.param == "local":
        yield request.getfixturevalue("two_workers")
    else:
        with Batch(scheduler=request.getfixturevalue("cluster").with_two_workers()) as run:
            yield run


def test_the_item_of_a_killed_worker_is_run_again(batch: Batch, files: list[Path]) -> None:
    killer = threading.Thread(target=Trap(files[7]).kill_one)
    killer.start()
    assert list(batch.map(Path.read_text, files)) == list(map(str, range(20)))
    killer.join()


def test_only_the_item_that_kills_its_workers_is_named(two_workers: Batch) -> None:
    results = two_workers.map(signal.raise_signal, [0] * 5 + [KILL] + [0] * 5)
    assert list(islice(results, 5)) == [None] * 5
    with pytest.raises(InputError, match=f"^{KILL}: .*killed"):
        next(results)


def test_an_item_that_kills_the_workers_of_a_cluster_is_named(cluster: Cluster) -> None:
    with Batch(scheduler=cluster.with_two_workers()) as run:
        results = run.map(signal.raise_signal, [KILL])
        with pytest.raises(InputError, match=f"^{KILL}: .*killed"):
            next(results)


def test_a_worker_killed_while_it_is_started_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulated by the broken pipe that follows: a test cannot kill the worker in time."""
    real, broken = ProcessPoolExecutor.submit, iter([BrokenPipeError(), BrokenPipeError()])

    def submit(executor: ProcessPoolExecutor, *task: Any) -> Any:
        if error := next(broken, None):
            raise error
        return real(executor, *task)

    monkeypatch.setattr(ProcessPoolExecutor, "submit", submit)
    with Batch(2, start_up_s=0.0) as run:
        assert list(run.map(abs, [-1, 2, -3])) == [1, 2, 3]


# workers end with the command

READS_FILES = """
import signal, sys
from pathlib import Path
from capture.batch.runner import Batch

for number in (signal.SIGTERM, signal.SIGQUIT):
    signal.signal(number, signal.default_int_handler)
try:
    with Batch(2, start_up_s=0.0) as run:
        list(run.map(Path.read_text, map(Path, sys.argv[1:])))
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.parametrize("ending", ["SIGINT", "SIGTERM", "SIGQUIT", "SIGKILL"])
def test_workers_end_with_the_command(files: list[Path], ending: str) -> None:
    trap = Trap(files[7])
    process = subprocess.Popen(
        [sys.executable, "-c", READS_FILES, *files],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        start_new_session=True,
    )
    worker, writing = trap.caught()
    if ending in ("SIGINT", "SIGQUIT"):  # a terminal sends them to all processes of the command
        os.killpg(process.pid, signal.Signals[ending])
    else:
        process.send_signal(signal.Signals[ending])
    output = process.communicate(timeout=DEADLINE_S)
    until_so(lambda: not Path(f"/proc/{worker}").exists())
    os.close(writing)
    if ending != "SIGKILL":
        assert (process.returncode, *output) == (130, b"", b"")


INTERRUPTED_CV2 = """
import time
import __main__
try:
    __main__.lifeline.close()
    time.sleep(60)
except BaseException:
    print('OpenCV bindings requires "numpy" package.')
    raise
"""
BEGINS_LATE = """
from multiprocessing import Pipe
from capture.batch.local_pool import _at_work, _begin_worker, call_in_one_thread

far_end, lifeline = Pipe(duplex=False)
_begin_worker(far_end)
_at_work.set()
call_in_one_thread(abs, -1)
"""


def test_a_worker_that_begins_as_the_command_ends_prints_nothing(tmp_path: Path) -> None:
    (tmp_path / "cv2.py").write_text(INTERRUPTED_CV2)
    done = subprocess.run(
        [sys.executable, "-c", BEGINS_LATE],
        capture_output=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        timeout=DEADLINE_S,
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, b"", b"")


# the same results everywhere


def everywhere(cluster: Cluster) -> dict[str, dict[str, Any]]:
    """Options of `Batch` for this process, for worker processes and for a cluster."""
    return {
        "here": {"workers": 1},
        "local": {"workers": 2, "start_up_s": 0.0},
        "dask": {"scheduler": cluster.with_two_workers()},
    }


def test_results_and_errors_are_the_same_everywhere(
    sets: Path, tmp_path: Path, cluster: Cluster
) -> None:
    paths = sorted(sets.glob("*.ome.tif"))
    damaged = tmp_path / "damaged.ome.tif"
    damaged.write_bytes(b"hello")
    results = []
    for name, options in everywhere(cluster).items():
        folder = tmp_path / name
        folder.mkdir()
        library = folder / "t.ps4lib"
        tasks = [SolveTask(path, folder / path.stem) for path in paths]
        with Batch(**options) as run:
            trained, _ = train_library(paths, tmp_path, run)
            trained.save(library)
            answers = list(run.map(partial(classify_set, library=library), paths))
            solved = list(run.map(partial(solve_set, method=None), tasks))
            with pytest.raises(InputError, match=f"^{damaged}: not a readable TIFF"):
                list(run.map(read_header, [paths[0], damaged]))
        learned = (
            trained.labels,
            trained.orientations_deg.tolist(),
            trained.signatures.tobytes(),
            {name: values.tolist() for name, values in trained.parameters.items()},
            dict(trained.limits),
        )
        written = {
            path.relative_to(folder): path.read_bytes()
            for task in tasks
            for path in sorted(task.folder.iterdir())
        }
        results.append((answers, solved, learned, written))
    assert results[1] == results[0]
    assert results[2] == results[0]


# clusters that do not answer


def test_missing_dask_is_one_line(
    refused: Command, sets: Path, library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    line = refused("classify", sets, "--library", library, "--scheduler", "tcp://127.0.0.1:1")
    assert line.endswith("pip install 'ps4rig[dask]'")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "ipx://a:1"])
def test_a_scheduler_that_does_not_answer_is_an_input_error(address: str) -> None:
    pytest.importorskip("distributed")
    before = set(threading.enumerate())
    with pytest.raises(InputError, match=f"^--scheduler {address}: no Dask scheduler answers"):
        DaskPool(address, answer_s=0.2)
    # A thread of a failed client can keep the next client from starting.
    assert "IO loop" not in {thread.name for thread in set(threading.enumerate()) - before}


# Nothing, an SSH server, and frames of sizes that Dask believes.
@pytest.mark.parametrize("words", [b"", b"SSH-2.0-OpenSSH_9.2p1\r\n", b"\1" + bytes(7) + b"\1" * 8])
def test_a_server_of_another_kind_is_an_input_error(words: bytes) -> None:
    pytest.importorskip("distributed")
    with socket.create_server(("127.0.0.1", 0)) as server:

        def speak() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(words)
                connection.recv(1 << 20)  # Dask's greeting
                connection.recv(1)  # until Dask hangs up

        thread = threading.Thread(target=speak, daemon=True)
        thread.start()
        with pytest.raises(InputError, match=r"no Dask scheduler"):
            DaskPool(f"tcp://127.0.0.1:{server.getsockname()[1]}", answer_s=0.2)
        thread.join(DEADLINE_S)


def test_workers_with_another_version_are_an_input_error(cluster: Cluster) -> None:
    with pytest.raises(InputError, match=r"worker tcp://.* ps4rig 0\.0\.7"):
        DaskPool(cluster.with_two_workers(), version="0.0.7")


def test_a_scheduler_that_stops_is_an_input_error(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    cluster = Cluster(tmp_path)
    with Batch(scheduler=cluster.address) as run:
        results = run.map(os.readlink, [SELF])
        threading.Timer(0.2, cluster.stop).start()
        with pytest.raises(InputError, match="connection to the cluster"):
            next(results)
