"""`ps4rig rig lights`, as a process with a simulated controller in real time."""

import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_sim import RealClock, Server, SimulatedBoard, SimulatedController, serve_pty

Command = Callable[..., Any]
Refused = Callable[..., str]


@dataclass(frozen=True)
class Bench:
    board: SimulatedBoard
    server: Server
    config: Path

    def lit(self, at_s: float | None = None) -> list[float]:
        at_s = time.monotonic() if at_s is None else at_s
        return [round(self.board.output(led, at_s), 2) for led in range(self.board.led_count)]


def write_config(bench: Bench, watchdog_ms: int) -> None:
    bench.config.write_text(
        f"[lights]\nport = '{bench.server.address}'\nwatchdog_ms = {watchdog_ms}\n"
        "[camera]\nkind = 'v4l2'\ndevice = 'none'\npixel_format = 'GREY'\n"
    )


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    clock = RealClock()
    board = SimulatedBoard(clock)
    with serve_pty(SimulatedController(board, clock)) as server:
        bench = Bench(board, server, tmp_path / "rig.toml")
        write_config(bench, watchdog_ms=60_000)
        yield bench


@pytest.mark.slow
def test_an_led_is_on_until_an_interrupt(bench: Bench, spawn: Callable[..., Any]) -> None:
    write_config(bench, watchdog_ms=5000)
    process = spawn("rig", "lights", 2, "--level", 40, "--rig", bench.config)
    while bench.lit() != [0.0, 0.0, 0.4, 0.0]:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)
    time.sleep(5.5)  # longer than the watchdog time
    assert bench.lit() == [0.0, 0.0, 0.4, 0.0]
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=120)
    assert (process.returncode, stderr) == (0, "")
    assert stdout.splitlines() == ["LED 2 is on at 40 %; Ctrl-C puts it out", "all LEDs are out"]
    assert bench.lit() == [0.0] * 4


@pytest.mark.slow
@pytest.mark.parametrize(
    "signals", [("SIGINT", "SIGINT"), ("SIGTERM", "SIGINT"), ("SIGQUIT",), ("SIGHUP",)]
)
def test_the_leds_are_out_before_the_message_says_so(
    bench: Bench, spawn: Callable[..., Any], signals: tuple[str, ...]
) -> None:
    process = spawn("rig", "lights", 2, "--rig", bench.config)
    assert process.stdout.readline() == "LED 2 is on at 100 %; Ctrl-C puts it out\n"
    for name in signals:
        process.send_signal(signal.Signals[name])
        time.sleep(0.001)
    assert process.stdout.readline() == "all LEDs are out\n"
    printed_s = time.monotonic()
    time.sleep(0.01)
    assert bench.board.output(2, printed_s + 0.002) < 0.01  # the light falls in 0.3 ms
    process.communicate(timeout=120)
    assert process.returncode == 0


@pytest.mark.slow
def test_cycle_lights_one_led_after_the_other(bench: Bench, spawn: Callable[..., Any]) -> None:
    started_s = time.monotonic()
    process = spawn("rig", "lights", "cycle", "--rig", bench.config)
    for led in (0, 1, 2, 3, 0):
        assert process.stdout.readline().startswith(f"LED {led} is on")
    seen: list[int] = []
    for at_s in np.arange(started_s, time.monotonic(), 0.01):
        lit = bench.lit(at_s)
        assert sum(lit) <= 1.01
        if sorted(lit) == [0.0, 0.0, 0.0, 1.0] and seen[-1:] != [lit.index(1.0)]:
            seen.append(lit.index(1.0))
    assert seen[:4] == [0, 1, 2, 3]
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    assert process.returncode == 0
    assert bench.lit() == [0.0] * 4


def test_off_puts_all_leds_out_and_ends(ps4rig: Command, bench: Bench) -> None:
    done = ps4rig("rig", "lights", "off", "--rig", bench.config)
    assert done.exit_code == 0
    assert done.output == "all LEDs of SIM-0001 are out\n"


def test_an_argument_that_is_not_an_led_is_refused(refused: Refused, bench: Bench) -> None:
    assert "LED 4: the controller has 4" in refused("rig", "lights", 4, "--rig", bench.config)
    assert "cycle or off" in refused("rig", "lights", "red", "--rig", bench.config)
    assert bench.lit() == [0.0] * 4
