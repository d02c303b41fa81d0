"""Virtual time: exact, cheap, common to all threads."""

import threading
import time

import pytest

from firmware_sim import RealClock, VirtualClock


def test_time_moves_only_by_sleeping():
    clock = VirtualClock(start_s=7.0)
    assert clock.now_s() == 7.0
    clock.sleep_s(0.25)
    assert clock.now_s() == 7.25
    clock.sleep_s(0.0)
    clock.sleep_s(-1.0)
    assert clock.now_s() == 7.25


def test_steps_of_one_millisecond_and_a_rest():
    clock = VirtualClock()
    ticks: list[float] = []
    clock.on_tick(lambda: ticks.append(clock.now_s()))
    clock.sleep_s(0.0035)
    assert ticks == [0.001, 0.002, 0.003, 0.0035]


def test_many_steps_add_up_without_rounding():
    clock = VirtualClock()
    for _ in range(10_000):
        clock.sleep_s(0.0001)
    assert clock.now_s() == 1.0


def test_unregister():
    clock = VirtualClock()
    calls: list[str] = []

    def tick() -> None:
        calls.append("tick")

    unregister_first = clock.on_tick(tick)
    clock.on_tick(tick)
    clock.sleep_s(0.001)
    unregister_first()
    unregister_first()
    clock.sleep_s(0.001)
    assert calls == ["tick"] * 3


def test_a_callback_must_not_sleep():
    clock = VirtualClock()
    unregister = clock.on_tick(lambda: clock.sleep_s(1.0))
    with pytest.raises(RuntimeError, match="must not sleep"):
        clock.sleep_s(0.001)
    unregister()
    clock.sleep_s(0.001)


def test_threads_share_the_time():
    clock = VirtualClock()
    ticks: list[float] = []
    clock.on_tick(lambda: ticks.append(clock.now_s()))
    sleepers = [threading.Thread(target=clock.sleep_s, args=(0.5,)) for _ in range(8)]
    for sleeper in sleepers:
        sleeper.start()
    for sleeper in sleepers:
        sleeper.join()
    assert 0.5 <= clock.now_s() <= 8 * 0.5
    assert ticks == sorted(set(ticks))


def test_long_sleeps_are_cheap(new_device):
    device = new_device()
    device.exchange(b"SYST:WDOG 60000\nLED:SEL 1\n")
    durations_s = []
    for _ in range(3):
        start_s = time.perf_counter()
        device.clock.sleep_s(5.0)
        durations_s.append(time.perf_counter() - start_s)
    assert min(durations_s) < 0.02


def test_the_real_clock_is_the_monotonic_one():
    clock = RealClock()
    before_s = time.monotonic()
    assert before_s <= clock.now_s() <= time.monotonic()
    clock.sleep_s(-1.0)
    clock.sleep_s(0.001)
    assert clock.now_s() - before_s >= 0.001
