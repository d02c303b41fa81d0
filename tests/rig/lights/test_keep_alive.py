"""The watchdog stays quiet while the program lives, in simulated and real time."""

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from typing import Any

import pytest

from firmware_sim import RealClock, SimulatedBoard, SimulatedController, VirtualClock, serve_pty
from rig import LightControllerError, RigConfig, open_rig
from rig.lights.driver import LightController
from rig.lights.keep_alive import KeepAliveClock, KeepAliveThread
from rig.lights.link import ControllerLink, LinkTimeouts, Reply
from tests.waiting import until_so

SMALL = RigConfig().with_changes(
    camera={"width_px": 32, "height_px": 32}, lights={"watchdog_ms": 400}
)


def output(rig: Any, led: int) -> float:
    return float(rig.simulation.board.output(led, rig.clock.now_s()))


def test_frames_may_be_read_for_longer_than_the_watchdog_waits() -> None:
    with open_rig(SMALL) as rig:
        rig.lights.select(1)
        for _ in range(40):
            rig.camera.read(1.0)
        assert rig.lights.confirm(1).led == 1


def test_lights_that_are_not_used_for_long_go_out() -> None:
    with open_rig(SMALL, timeouts=LinkTimeouts(unused_s=20.0)) as rig:
        rig.lights.select(2)
        rig.clock.sleep_s(19.0)
        assert output(rig, 2) == 1.0
        rig.clock.sleep_s(2.0)
        assert output(rig, 2) == 0.0
        with pytest.raises(LightControllerError, match="LED 2 should be lit"):
            rig.lights.confirm(2)


def test_the_driver_alone_is_kept_alive_by_its_caller(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock, watchdog_ms=300) as lights:
        lights.select(0)
        for _ in range(5):
            bench.clock.sleep_s(0.14)
            assert 0.0 < lights.keep_alive_if_due() <= 0.15
            bench.clock.sleep_s(0.011)
            assert lights.keep_alive_if_due() == 0.15
        assert lights.confirm(0).led == 0


def test_nothing_is_sent_for_a_thread_that_has_ended(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock, watchdog_ms=300) as lights:
        thread = threading.Thread(target=lights.select, args=(3,))
        thread.start()
        thread.join()
        for _ in range(4):
            bench.clock.sleep_s(0.1)
            lights.keep_alive_if_due()
        assert bench.lit() == [0.0] * 4


def test_nothing_is_sent_during_an_exchange(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock, watchdog_ms=1000) as lights:
        lights.select(1)
        bench.clock.sleep_s(0.9)
        with lights._lock:
            thread = threading.Thread(target=lambda: waits.append(lights.keep_alive_if_due()))
            waits: list[float] = []
            thread.start()
            thread.join()
        assert waits == [0.5]
        bench.clock.sleep_s(0.2)
        with pytest.raises(LightControllerError, match=r"oldest error .*Watchdog"):
            lights.confirm(1)


def test_no_keep_alive_comes_between_a_state_and_its_check(
    bench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Slow(str):
        def count(self, *arguments: Any) -> int:
            bench.clock.sleep_s(0.3)  # the program stands still, and a keep-alive is due
            thread = threading.Thread(target=lights.keep_alive_if_due)
            thread.start()
            thread.join()
            return super().count(*arguments)

    ask = ControllerLink.ask

    def slow(link: ControllerLink, command: str) -> Reply:
        reply = ask(link, command)
        asked_here = threading.current_thread() is test_thread
        return replace(reply, text=Slow(reply.text)) if asked_here else reply

    test_thread = threading.current_thread()
    with LightController(bench.port, clock=bench.clock, watchdog_ms=400) as lights:
        monkeypatch.setattr(ControllerLink, "ask", slow)
        assert lights.state().led is None
        monkeypatch.undo()


def test_the_next_exchange_raises_a_failed_keep_alive_once() -> None:
    with open_rig(SMALL) as rig:
        assert rig.simulation is not None
        rig.lights.select(0)
        rig.simulation.unplug_lights()
        rig.clock.sleep_s(1.0)
        with pytest.raises(LightControllerError, match=r"keep-alive failed: .*gone"):
            rig.lights.select(1)
        rig.simulation.replug_lights()
        rig.lights.recover()
        assert rig.lights.select(1).led == 1


def test_a_restart_without_a_banner_is_noticed(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock, watchdog_ms=700) as lights:
        bench.clock.sleep_s(1.0)
        lights.state()
        bench.controller.reset()
        bench.clock.sleep_s(0.5)
        bench.controller.take_output()  # the banner is lost
        lights.keep_alive_if_due()
        with pytest.raises(LightControllerError, match=r"keep-alive failed: .*restarted"):
            lights.select(1)


def test_nothing_is_sent_after_a_failure_so_the_watchdog_trips(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock, watchdog_ms=400) as lights:
        lights.select(3)
        with pytest.raises(LightControllerError):
            lights.ask("*IDN?", 1)  # not a number
        for _ in range(4):
            bench.clock.sleep_s(0.15)
            lights.keep_alive_if_due()
        assert bench.lit() == [0.0] * 4


@pytest.mark.slow
def test_a_thread_keeps_the_led_on_in_real_time_until_the_rig_is_closed() -> None:
    config = SMALL.with_changes(simulation={"clock": "real"}, lights={"watchdog_ms": 5000})
    with open_rig(config) as rig:
        rig.lights.select(1)
        time.sleep(5.5)
        assert rig.lights.confirm(1).led == 1
        assert [thread.name for thread in threading.enumerate()].count("light keep-alive") == 1
    assert "light keep-alive" not in [thread.name for thread in threading.enumerate()]


def test_a_stopped_keep_alive_makes_no_further_call() -> None:
    calls: list[float] = []
    keep_alive = KeepAliveThread(lambda: calls.append(time.monotonic()) or 0.01)  # type: ignore[func-returns-value]
    until_so(lambda: len(calls) >= 2)
    keep_alive.stop(60.0)
    count = len(calls)
    time.sleep(0.05)
    assert len(calls) == count


def test_a_keep_alive_clock_has_the_time_of_its_inner_clock() -> None:
    inner = VirtualClock(5.0)
    clock = KeepAliveClock(inner)
    clock.sleep_s(0.25)
    asked: list[float] = []

    def keep_alive() -> float:
        asked.append(inner.now_s())
        return 0.0 if len(asked) == 3 else 0.1

    clock.keep_alive_with(keep_alive)
    clock.sleep_s(0.25)
    assert clock.now_s() == inner.now_s() == pytest.approx(5.5, abs=1e-8)
    assert asked == pytest.approx([5.25, 5.35, 5.45, 5.45], abs=1e-8)
    clock.keep_alive_with(None)
    clock.sleep_s(-1.0)
    assert clock.now_s() == inner.now_s()


_HOLDS_AN_LED = """
import sys, time
sys.path[:] = {path!r}
from rig.lights.driver import LightController
lights = LightController({port!r}, watchdog_ms=5000)
lights.keep_alive()
lights.select(2)
print("lit", flush=True)
time.sleep(60)
"""


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGSTOP, signal.SIGKILL], ids=["hangs", "dies"])
def test_the_led_of_a_program_that_hangs_or_dies_goes_out(end: signal.Signals) -> None:
    clock = RealClock()
    board = SimulatedBoard(clock)
    with serve_pty(SimulatedController(board, clock)) as server:
        script = _HOLDS_AN_LED.format(path=sys.path, port=server.address)
        program = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)
        try:
            assert program.stdout is not None
            assert program.stdout.readline() == b"lit\n"
            time.sleep(5.5)
            assert board.output(2, clock.now_s()) > 0.99
            os.kill(program.pid, end)
            until_so(lambda: board.output(2, clock.now_s()) < 0.01)
        finally:
            program.kill()
            program.wait()
            assert program.stdout is not None
            program.stdout.close()
