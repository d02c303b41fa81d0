"""A block runs to its end, and the signal is delivered afterwards."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from rig.lights.driver import LightController
from rig.signals import signals_held_back


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Each signal raises KeyboardInterrupt, and is handled as before after the test."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    before = {number: signal.getsignal(number) for number in numbers}
    for number in numbers:
        signal.signal(number, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_is_delivered_after_the_action(number: signal.Signals) -> None:
    # The kernel may give a signal to any thread that has not masked it.
    idle = threading.Event()
    thread = threading.Thread(target=idle.wait)
    thread.start()
    steps = []

    with pytest.raises(KeyboardInterrupt), signals_held_back():  # noqa: PT012
        steps.append("begin")
        os.kill(os.getpid(), number)
        time.sleep(0.01)
        steps.append("end")
    idle.set()
    thread.join()
    assert steps == ["begin", "end"]
    with pytest.raises(KeyboardInterrupt):  # and the handlers are as before
        signal.raise_signal(number)


def test_an_ignored_signal_stays_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with signals_held_back():
        signal.raise_signal(signal.SIGHUP)
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_a_block_of_another_thread_is_run() -> None:
    done = threading.Event()

    def act() -> None:
        with signals_held_back():
            done.set()

    thread = threading.Thread(target=act)
    thread.start()
    thread.join()
    assert done.is_set()


def test_the_leds_go_out_when_closing_is_interrupted(damaged_device: Any) -> None:
    def interrupt(command: str, reply: bytes) -> list[bytes]:
        if "LED:OFF" in command:
            os.kill(os.getpid(), signal.SIGINT)
        return [reply]

    line = damaged_device(interrupt)
    lights = LightController(line.port)
    lights.select(1)
    with pytest.raises(KeyboardInterrupt):
        lights.close()
    line.clock.sleep_s(0.05)
    assert line.board.output(1, line.clock.now_s()) < 0.01
