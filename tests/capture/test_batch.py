"""Many sets: here, on processes of this machine, on a Dask cluster; and workers that are killed."""

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import count, islice
from pathlib import Path
from typing import Any

import pytest

from capture.batch import dask_pool, runner
from capture.batch.runner import Batch
from capture.batch.tasks import read_header
from classify import InputError, TextureLibrary

Command = Callable[..., Any]
DEADLINE_S = 60.0
KILL = int(signal.SIGKILL)
SELF = "/proc/self"  # a link to the number of the process that reads it

# Processes are started and killed in most of these.
pytestmark = pytest.mark.slow
at_once = pytest.mark.usefixtures("_workers_at_once")


@pytest.fixture
def _workers_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "STARTING_S", 0.0)


def eventually(condition: Callable[[], Any]) -> Any:
    """What the condition gives, as soon as that is something."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not (value := condition()):
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    return value


class Cluster:
    """A scheduler and two workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._workers: dict[str, subprocess.Popen[bytes]] = {}
        described = folder / "scheduler.json"
        self._scheduler = self._start("scheduler", "--port=0", f"--scheduler-file={described}")
        self.address: str = eventually(lambda: described.exists() and described.read_text())
        self.address = json.loads(self.address)["address"]

    def whole(self) -> str:
        """The address, as soon as both workers are alive."""
        from distributed import Client

        for name, worker in list(self._workers.items()):
            if worker.poll() is not None:
                del self._workers[name]
        while len(self._workers) < 2:
            name = f"worker-{time.monotonic_ns()}"
            # Two threads, of which one has to wait for the other.
            options = ("--nthreads=2", "--no-nanny", f"--local-directory={self._folder}")
            self._workers[name] = self._start("worker", self.address, f"--name={name}", *options)
        with Client(self.address, set_as_default=False) as client:
            eventually(lambda: len(client.nthreads()) == 2)
        return self.address

    def kill_a_worker_at_work(self) -> None:
        from distributed import Client

        name, worker = next(iter(self._workers.items()))
        with Client(self.address, set_as_default=False) as client:
            known = client.scheduler_info()["workers"]
            (address,) = [key for key, about in known.items() if about["name"] == name]
            eventually(lambda: client.processing()[address])
            worker.kill()

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
    """Files that hold their own numbers."""
    paths = [tmp_path / f"file{number:02d}" for number in range(20)]
    for number, path in enumerate(paths):
        path.write_text(str(number))
    return paths


class Trap:
    """A pipe in the place of a file: the process that reads the file waits in it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.with_suffix(".file")
        path.rename(self._file)
        os.mkfifo(path)

    def caught(self) -> tuple[int, int]:
        """The process that waits, as soon as there is one, and what keeps it waiting."""
        writing = eventually(self._writing)
        return eventually(self._reader), writing

    def kill_one(self) -> None:
        """Kill whom it catches; whoever comes next finds the file."""
        reader, writing = self.caught()
        self._file.rename(self._path)
        os.kill(reader, signal.SIGKILL)
        os.close(writing)

    def _writing(self) -> int | None:
        try:
            return os.open(self._path, os.O_WRONLY | os.O_NONBLOCK)
        except OSError:  # nobody reads
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
    """A batch on two processes, for all tests that need not have their own."""
    with pytest.MonkeyPatch.context() as patched, Batch(2) as run:
        patched.setattr(runner, "STARTING_S", 0.0)
        assert list(run.map(str, [0])) == ["0"]
        yield run


# where it runs, and in which order


def test_what_takes_less_time_than_starting_a_worker_is_done_here() -> None:
    with Batch() as run:
        assert list(run.map(os.readlink, [SELF] * 9)) == [str(os.getpid())] * 9


@at_once
def test_one_worker_is_this_process() -> None:
    with Batch(workers=1) as run:
        assert list(run.map(os.readlink, [SELF] * 9)) == [str(os.getpid())] * 9


def test_longer_work_goes_on_in_other_processes_which_are_gone_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(runner, "STARTING_S", 1e-9)
    before = workers()
    with Batch(workers=2) as run:
        first, *rest = run.map(os.readlink, [SELF] * 9)
        assert first == str(os.getpid())
        started = workers() - before
        assert 1 <= len(started) <= 2
        assert set(map(int, rest)) <= started
        # The same processes for whatever comes next.
        assert set(map(int, run.map(os.readlink, [SELF] * 9))) <= started
    assert workers() == before


def test_results_come_in_order_and_no_more_items_are_taken_than_needed(
    two_workers: Batch,
) -> None:
    taken = count()
    results = two_workers.map(str, taken)
    assert list(islice(results, 100)) == list(map(str, range(100)))
    assert next(taken) <= 100 + 4 * 2


def test_an_error_comes_in_its_turn_as_it_was_raised(two_workers: Batch, sets: Path) -> None:
    good = sets / "rock-001.ome.tif"
    results = two_workers.map(read_header, [good, good, sets / "none.ome.tif", good])
    assert [next(results).label, next(results).label] == ["rock", "rock"]
    with pytest.raises(InputError, match=r"none\.ome\.tif: no such file$"):
        next(results)


# workers that are killed


def test_a_worker_killed_at_an_item_changes_nothing(two_workers: Batch, files: list[Path]) -> None:
    killer = threading.Thread(target=Trap(files[7]).kill_one)
    killer.start()
    assert list(two_workers.map(Path.read_text, files)) == list(map(str, range(20)))
    killer.join()


def test_a_worker_of_a_cluster_killed_at_an_item_changes_nothing(
    files: list[Path], cluster: Cluster
) -> None:
    address = cluster.whole()
    killer = threading.Thread(target=Trap(files[7]).kill_one)
    killer.start()
    with Batch(scheduler=address) as run:
        assert list(run.map(Path.read_text, files)) == list(map(str, range(20)))
    killer.join()


def test_an_item_that_kills_its_workers_is_named_and_no_other(two_workers: Batch) -> None:
    results = two_workers.map(signal.raise_signal, [0] * 5 + [KILL] + [0] * 5)
    assert list(islice(results, 5)) == [None] * 5
    with pytest.raises(InputError, match=f"^{KILL}: the workers that had it were killed"):
        next(results)


@at_once
def test_a_worker_killed_before_it_reads_what_to_do_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whoever starts it then writes into a broken pipe; too early for a test to kill in time."""
    real, broken = ProcessPoolExecutor.submit, iter([BrokenPipeError(), BrokenPipeError()])

    def submit(executor: ProcessPoolExecutor, *task: Any) -> Any:
        if error := next(broken, None):
            raise error
        return real(executor, *task)

    monkeypatch.setattr(ProcessPoolExecutor, "submit", submit)
    with Batch(2) as run:
        assert list(run.map(abs, [-1, 2, -3])) == [1, 2, 3]


def test_an_item_that_kills_the_workers_of_a_cluster_is_named(cluster: Cluster) -> None:
    with Batch(scheduler=cluster.whole()) as run:
        results = run.map(signal.raise_signal, [KILL])
        with pytest.raises(InputError, match=f"^{KILL}: the workers that had it were killed"):
            next(results)


# the end of a command is the end of its workers

READS_FILES = """
import signal, sys
from pathlib import Path
from capture import batch

signal.signal(signal.SIGTERM, signal.default_int_handler)
batch.STARTING_S = 0.0
try:
    with batch.Batch(2) as run:
        list(run.map(Path.read_text, map(Path, sys.argv[1:])))
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_the_command(files: list[Path], ending: signal.Signals) -> None:
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
    if ending == signal.SIGINT:
        os.killpg(process.pid, ending)  # as a terminal does
    else:
        process.send_signal(ending)
    output = process.communicate(timeout=DEADLINE_S)
    eventually(lambda: not Path(f"/proc/{worker}").exists())
    os.close(writing)
    if ending != signal.SIGKILL:
        assert (process.returncode, *output) == (130, b"", b"")


# the commands, wherever they run


def everywhere(address: str) -> dict[str, tuple[object, ...]]:
    return {"here": ("--workers", 1), "local": ("--workers", 2), "dask": ("--scheduler", address)}


@at_once
def test_all_commands_give_the_same_everywhere(
    ps4rig: Command, sets: Path, tmp_path: Path, cluster: Cluster
) -> None:
    results = {}
    for name, where in everywhere(cluster.whole()).items():
        library, maps = tmp_path / name / "t.ps4lib", tmp_path / name / "maps"
        library.parent.mkdir()
        outputs = [
            ps4rig("train", sets, "--library", library, "--json", *where),
            ps4rig("classify", sets, "--library", library, "--json", *where),
            ps4rig("evaluate", sets, "--library", library, "--json", *where),
            ps4rig("solve", sets, "--out", maps, "--json", *where),
        ]
        assert [output.exit_code for output in outputs] == [0] * 4
        trained = TextureLibrary.load(library)
        learned = (
            trained.labels,
            trained.orientations_deg.tolist(),
            trained.signatures.tobytes(),
            {name: values.tolist() for name, values in trained.parameters.items()},
            dict(trained.limits),
        )
        written = {
            path.relative_to(maps): path.read_bytes()
            for path in sorted(maps.rglob("*"))
            if path.is_file()
        }
        texts = [output.stdout.replace(str(tmp_path / name), "OUT") for output in outputs]
        results[name] = (texts, learned, written)
    assert results["local"] == results["here"]
    assert results["dask"] == results["here"]
    assert {path.parts[0] for path in results["here"][2]} == {
        "rock-001", "rock-002", "sand-001", "sand-002",
    }  # fmt: skip


@at_once
@pytest.mark.parametrize("place", ["local", "dask"])
def test_a_killed_worker_changes_no_answer(
    ps4rig: Command, sets: Path, library: Path, cluster: Cluster, place: str
) -> None:
    where = everywhere(cluster.whole())
    expected = json.loads(
        ps4rig("classify", sets, "--library", library, "--json", *where["here"]).stdout
    )
    others = workers()

    def kill_a_process() -> None:
        os.kill(min(eventually(lambda: workers() - others)), signal.SIGKILL)

    killers = {"local": kill_a_process, "dask": cluster.kill_a_worker_at_work}
    killer = threading.Thread(target=killers[place])
    killer.start()
    # Enough to be still at it when the worker is killed.
    places = [sets] * {"local": 2, "dask": 40}[place]
    result = ps4rig("classify", *places, "--library", library, "--json", *where[place])
    killer.join()
    assert json.loads(result.stdout) == expected * len(places)


@at_once
def test_what_is_wrong_with_a_set_is_the_same_line_everywhere(
    refused: Command, sets: Path, library: Path, tmp_path: Path, cluster: Cluster
) -> None:
    copied = Path(shutil.copytree(sets, tmp_path / "copied"))
    (copied / "sand-001.ome.tif").write_bytes(b"hello")
    lines = {
        refused("classify", copied, "--library", library, *where)
        for where in everywhere(cluster.whole()).values()
    }
    (line,) = lines
    assert line.startswith(f"{copied / 'sand-001.ome.tif'}: not a readable TIFF")


def test_paths_may_be_relative_for_a_cluster_too(
    ps4rig: Command, sets: Path, library: Path, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(sets.parent)
    path = sets.relative_to(sets.parent) / "rock-001.ome.tif"
    where = ("--scheduler", cluster.whole())
    result = ps4rig("classify", path, "--library", library.name, "--json", *where)
    assert json.loads(result.stdout)[0]["set"] == str(path)


# clusters that are not there


def test_dask_that_is_not_installed_is_one_line(
    refused: Command, sets: Path, library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    line = refused("classify", sets, "--library", library, "--scheduler", "tcp://127.0.0.1:1")
    assert line.endswith("Dask is not installed; pip install 'ps4rig[dask]'")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "ipx://a:1"])
def test_a_scheduler_that_does_not_answer_is_one_line(
    refused: Command, sets: Path, library: Path, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(dask_pool, "_ANSWER_S", 0.2)
    line = refused("classify", sets, "--library", library, "--scheduler", address)
    assert line.startswith(f"--scheduler {address}: no Dask scheduler answers")


def test_workers_with_another_version_are_one_line(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_pool, "_VERSION", "0.0.7")
    with pytest.raises(InputError, match=r"worker tcp://.* has ps4rig .* this is ps4rig 0\.0\.7"):
        Batch(scheduler=cluster.whole())


def test_a_scheduler_that_goes_away_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    cluster = Cluster(tmp_path)
    with Batch(scheduler=cluster.address) as run:
        results = run.map(os.readlink, [SELF])
        threading.Timer(0.2, cluster.stop).start()
        with pytest.raises(InputError, match="the connection to the cluster broke"):
            next(results)
