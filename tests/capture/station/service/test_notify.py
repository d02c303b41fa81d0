"""Messages of a station to systemd, on a real datagram socket."""

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from capture.station.run.cycle import Station
from capture.station.run.events import Change, PartAnnounced, State, StateChanged
from capture.station.run.triggers import Trigger
from capture.station.service.systemd import Notifier
from classify.base.errors import InputError
from rig import HardwareError
from tests.capture.station.stations import (
    PASSED,
    Bench,
    Manual,
    Said,
    bench,
    published,
    small_set,
    until_ready,
)
from tests.waiting import Gate

# Short, so that a station that hangs is noticed in the time of a test.
WATCHDOG_S = 0.2
SILENCE_S = 4 * WATCHDOG_S
_TIMEOUT_S = 60.0


class SystemdSocket:
    """Receives datagrams as systemd does; `said` holds the lines of all of them."""

    def __init__(self, listening: socket.socket, address: str) -> None:
        self._listening = listening
        self.address = address
        self.said: list[list[str]] = []

    def receive(self, timeout_s: float) -> None:
        """Wait for a datagram, and take all that are there."""
        self._listening.settimeout(timeout_s)
        try:
            while True:
                self.said.append(self._listening.recv(4096).decode().split("\n"))
                self._listening.settimeout(0.0)
        except (TimeoutError, BlockingIOError):
            pass

    def until(self, is_there: Callable[[], bool]) -> None:
        """Receive until something holds."""
        ends_s = time.monotonic() + _TIMEOUT_S
        while not is_there():
            assert time.monotonic() < ends_s, self.said
            self.receive(0.2)

    def until_said(self, line: str) -> None:
        """Receive until a line begins so."""
        self.until(lambda: any(each.startswith(line) for lines in self.said for each in lines))

    def pings(self) -> int:
        """Number of pings of the watchdog."""
        return sum("WATCHDOG=1" in lines for lines in self.said)


@contextmanager
def systemd_socket(folder: Path, *, is_abstract: bool = False) -> Iterator[SystemdSocket]:
    """Listen on a socket in `folder`, or on one that has only a name."""
    name = str(folder / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(f"\0{name}" if is_abstract else name)
        yield SystemdSocket(listening, f"@{name}" if is_abstract else name)


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[SystemdSocket]:
    with systemd_socket(tmp_path) as listening:
        yield listening


@pytest.fixture
def station(tmp_path: Path, systemd: SystemdSocket) -> Iterator[Bench]:
    with bench(tmp_path / "line-1", small_set()) as made:
        notifier = Notifier(systemd.address, WATCHDOG_S)
        made.listen, made.report_alive = notifier.tell, notifier.report_alive
        yield made


def assert_silent(systemd: SystemdSocket) -> None:
    """No ping comes any more; one may be on its way."""
    systemd.receive(0.01)
    before, ends_s = systemd.pings(), time.monotonic() + SILENCE_S
    while time.monotonic() < ends_s:
        systemd.receive(WATCHDOG_S)
    assert systemd.pings() <= before + 1


def running(
    station: Bench, feed: Callable[[Station], object], count: int = 1, **changes: Any
) -> threading.Thread:
    """Run a station in a thread of its own."""

    def fed(target: Station) -> None:
        feed(target)

    thread = threading.Thread(target=lambda: station.run(Manual(fed), count, **changes))
    thread.start()
    return thread


def test_an_idle_station_is_ready_and_pings_the_watchdog(
    station: Bench, systemd: SystemdSocket
) -> None:
    gate = Gate()
    thread = running(station, gate.hold)
    systemd.until(lambda: systemd.pings() >= 4)
    gate.open()
    thread.join()
    systemd.until_said("STOPPING=1")
    first_ready = next(lines for lines in systemd.said if "READY=1" in lines)
    assert first_ready == ["READY=1", "STATUS=ready; parts: 0"]
    assert systemd.said[-1][0] == "STOPPING=1"


def triggered(target: Station) -> None:
    until_ready(target)
    target.submit(Trigger("timer"))


@pytest.mark.parametrize("stage", [pytest.param("capture", marks=pytest.mark.slow), "verdict"])
def test_a_thread_that_hangs_ends_the_pings_although_the_other_goes_on(
    station: Bench, systemd: SystemdSocket, stage: str
) -> None:
    gate = Gate()
    if stage == "capture":
        station.camera.on_capture = gate.hold
    else:
        station.inspector.inspect = lambda _: gate.hold() or Said(PASSED)
    thread = running(station, lambda target: (triggered(target), triggered(target)), 2)
    gate.until_reached()
    try:
        assert_silent(systemd)
    finally:
        gate.open()
        thread.join()
    systemd.until_said("STATUS=ready; parts: 2, the last part-000002 PASS")


def test_a_station_that_waits_for_its_rig_pings_on(station: Bench, systemd: SystemdSocket) -> None:
    has_failed = threading.Event()

    def lose(_: int) -> None:
        has_failed.set()
        raise HardwareError("the camera is gone")

    def feed(target: Station) -> None:
        triggered(target)
        assert has_failed.wait(60.0)
        systemd.until_said("STATUS=error: ")
        before = systemd.pings()
        systemd.until(lambda: systemd.pings() >= before + 6)

    station.camera.on_capture = lose
    running(station, feed, reconnect_s=3600.0).join()
    [error] = [event for event in station.of(StateChanged) if event.state is State.ERROR]
    assert "the camera is gone" in error.reason


def test_an_abstract_socket_is_told_too(tmp_path: Path) -> None:
    with systemd_socket(tmp_path, is_abstract=True) as systemd:
        Notifier(systemd.address).tell(
            *published(StateChanged(State.READY, Change.TESTED, why="tested\nREADY=0"))
        )
        systemd.receive(60.0)
    assert systemd.said == [["READY=1", "STATUS=ready; parts: 0"]]


def test_the_environment_of_systemd_is_understood(systemd: SystemdSocket) -> None:
    given = {"NOTIFY_SOCKET": systemd.address, "WATCHDOG_USEC": "30000000"}
    for process, pings in ((str(os.getpid()), 1), ("1", 0)):
        notifier = Notifier.from_environment(given | {"WATCHDOG_PID": process})
        notifier.tell(*published(StateChanged(State.READY, Change.TESTED)))
        notifier.report_alive("capture")
        notifier.report_alive("capture")
        notifier.report_alive("verdict")
        systemd.receive(60.0)
        assert systemd.pings() == pings
        systemd.said.clear()
    for name, value in (("NOTIFY_SOCKET", "vsock:2"), ("WATCHDOG_USEC", "soon")):
        with pytest.raises(InputError, match=f"{name}={value}"):
            Notifier.from_environment({name: value})


def test_without_systemd_nothing_is_told_and_nothing_fails() -> None:
    notifier = Notifier.from_environment({"WATCHDOG_USEC": "30000000"})
    notifier.tell(*published(StateChanged(State.READY, Change.TESTED)))
    for worker in ("capture", "verdict"):
        notifier.report_alive(worker)


def test_a_socket_that_nobody_serves_does_not_disturb_the_station(
    station: Bench, tmp_path: Path
) -> None:
    notifier = Notifier(str(tmp_path / "gone"), WATCHDOG_S)
    station.listen, station.report_alive = notifier.tell, notifier.report_alive
    station.run(Manual(triggered), 1)
    assert len(station.of(PartAnnounced)) == 1
