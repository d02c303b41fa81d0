"""Real and virtual clocks: sleeping, ticks, calls at given times, threads."""

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


def test_a_sleep_advances_in_steps_of_one_millisecond():
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


def test_an_unregistered_callback_is_not_called():
    clock = VirtualClock()
    calls: list[str] = []
    unregister_first = clock.on_tick(lambda: calls.append("first"))
    clock.on_tick(lambda: calls.append("second"))
    clock.sleep_s(0.001)
    unregister_first()
    unregister_first()
    clock.sleep_s(0.001)
    assert calls == ["first", "second", "second"]


def test_a_callback_must_not_sleep():
    clock = VirtualClock()
    unregister = clock.on_tick(lambda: clock.sleep_s(1.0))
    with pytest.raises(RuntimeError, match="must not sleep"):
        clock.sleep_s(0.001)
    unregister()
    clock.sleep_s(0.001)


def test_sleeping_threads_share_the_time():
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
        start_s = time.thread_time()
        device.clock.sleep_s(5.0)
        durations_s.append(time.thread_time() - start_s)
    assert min(durations_s) < 0.05


def test_the_real_clock_is_the_monotonic_one():
    clock = RealClock()
    before_s = time.monotonic()
    assert before_s <= clock.now_s() <= time.monotonic()
    clock.sleep_s(-1.0)
    clock.sleep_s(0.001)
    assert clock.now_s() - before_s >= 0.001


def test_calls_are_made_at_their_times_and_in_order():
    clock = VirtualClock()
    calls: list[tuple[str, float]] = []

    def note(name: str) -> None:
        calls.append((name, clock.now_s()))

    clock.on_tick(lambda: note("tick"))
    clock.call_at(0.0013, lambda: note("second"))
    clock.call_at(0.0002, lambda: note("first"))
    clock.call_at(0.0013, lambda: note("third"))
    clock.call_at(0.0020, lambda: note("later"))
    clock.sleep_s(0.0015)
    assert calls == [
        *[("first", 0.0002), ("tick", 0.001), ("second", 0.0013), ("third", 0.0013)],
        ("tick", 0.0015),
    ]


def test_a_call_may_add_another_call():
    clock = VirtualClock()
    calls_s: list[float] = []

    def call() -> None:
        calls_s.append(clock.now_s())
        if len(calls_s) < 4:
            clock.call_at(clock.now_s() + 0.0004, call)

    clock.sleep_s(0.010)
    clock.call_at(0.001, call)  # in the past: as soon as possible
    clock.sleep_s(0.001)
    assert calls_s == [0.010, 0.0104, 0.0108]
    clock.sleep_s(0.001)
    assert calls_s[3:] == [0.0112]


def test_the_real_clock_makes_calls_in_order():
    clock = RealClock()
    calls: list[tuple[str, float]] = []
    done = threading.Event()
    start_s = clock.now_s()
    clock.call_at(start_s + 0.02, lambda: calls.append(("second", clock.now_s())))
    clock.call_at(start_s + 0.01, lambda: calls.append(("first", clock.now_s())))
    clock.call_at(start_s + 0.03, done.set)
    assert done.wait(60.0)
    assert [name for name, _ in calls] == ["first", "second"]
    assert calls[0][1] >= start_s + 0.01
    assert calls[1][1] >= start_s + 0.02
    done.clear()
    clock.call_at(clock.now_s(), done.set)  # the clock's thread has ended or is ending
    assert done.wait(60.0)
