"""The simulated board: light over time, numeric against exact integrals, buffers, options."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import SimulatedBoard, VirtualClock
from firmware_sim.board import Led
from firmware_sim.firmware import STROBE_BUFFER_EDGES
from tests.memory_growth import growth_bytes

TIMES_MS = st.sampled_from([0.0, 0.05, 0.3, 0.5, 4.0])
GAPS_S = st.floats(1e-5, 5e-3)
BENDS = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0)


@given(
    switches=st.lists(st.tuples(GAPS_S, st.integers(0, 100)), max_size=8),
    rise_ms=TIMES_MS,
    fall_ms=TIMES_MS,
    interval=st.tuples(st.floats(0.0, 0.03), st.floats(0.0, 0.03)).map(sorted),
)
def test_the_integral_matches_the_output(switches, rise_ms, fall_ms, interval):
    clock = VirtualClock()
    board = SimulatedBoard(clock, rise_ms=rise_ms, fall_ms=fall_ms)
    changes_s = []
    for gap_s, percent in switches:
        clock.sleep_s(gap_s)
        board.set_led(1, percent)
        changes_s.append(clock.now_s())
    clock.sleep_s(0.03)
    start_s, end_s = interval

    # Pieces that are short compared with the time constants.
    bends_s = [
        at_s + k * ms / 1e3 for at_s in changes_s for k in BENDS for ms in (rise_ms, fall_ms)
    ]
    cuts_s = sorted({start_s, end_s, *(s for s in bends_s if start_s < s < end_s)})
    expected_s = sum(simpson_s(board, a, b) for a, b in pairwise(cuts_s))
    assert board.output_integral_s(1, start_s, end_s) == pytest.approx(expected_s, abs=1e-9)
    assert board.output_integral_s(0, start_s, end_s) == 0.0


def simpson_s(board: SimulatedBoard, start_s: float, end_s: float, steps: int = 20) -> float:
    """Simpson's rule, slightly inside the ends, since the output may jump at a switch."""
    inset_s = (end_s - start_s) * 1e-9
    step_s = (end_s - start_s) / steps
    points = [start_s + inset_s, *(start_s + i * step_s for i in range(1, steps)), end_s - inset_s]
    weights = [1, *(4 if i % 2 else 2 for i in range(1, steps)), 1]
    values = [board.output(1, at_s) for at_s in points]
    return step_s / 3 * sum(w * v for w, v in zip(weights, values, strict=True))


def test_rise_and_fall_times_are_from_10_to_90_percent():
    led = Led(rise_ms=0.5, fall_ms=0.3)
    led.drive(100, 1.0)
    led.drive(0, 2.0)
    rise_tau_s, fall_tau_s = 0.0005 / math.log(9), 0.0003 / math.log(9)
    crossing_10_s = 1.0 - rise_tau_s * math.log(0.9)
    assert led.output(crossing_10_s) == pytest.approx(0.1)
    assert led.output(crossing_10_s + 0.0005) == pytest.approx(0.9)
    crossing_90_s = 2.0 - fall_tau_s * math.log(0.9)
    assert led.output(crossing_90_s) == pytest.approx(0.9)
    assert led.output(crossing_90_s + 0.0003) == pytest.approx(0.1)


def test_the_same_drive_again_does_not_restart_the_approach():
    led, twice = Led(0.5, 0.3), Led(0.5, 0.3)
    led.drive(100, 1.0)
    twice.drive(100, 1.0)
    twice.drive(100, 1.0002)
    assert twice.output(1.0005) == led.output(1.0005)


def test_an_led_without_rise_time_switches_at_once():
    led = Led(rise_ms=0.0, fall_ms=0.0)
    led.drive(40, 1.0)
    led.drive(0, 2.0)
    assert led.output(0.999) == 0.0
    assert led.output(1.0) == 0.4
    assert led.output_integral_s(0.0, 5.0) == pytest.approx(0.4)


def test_an_led_that_is_switched_for_months_takes_no_more_memory():
    led = Led(0.5, 0.3)

    def switch(first: int, last: int) -> None:
        for number in range(first, last):
            led.drive(100 * (number % 2), number / 10.0)

    assert growth_bytes(switch, 1, 20_001, 40_001) < 10_000


def test_the_future_and_the_time_before_the_history_are_refused():
    clock = VirtualClock()
    board = SimulatedBoard(clock)
    clock.sleep_s(1.0)
    with pytest.raises(ValueError, match="not known yet"):
        board.output_integral_s(0, 0.5, 1.1)
    with pytest.raises(ValueError, match="before its start"):
        board.output_integral_s(0, 0.5, 0.4)
    led = Led(0.5, 0.3)
    for event in range(70_000):
        led.drive(event % 2, float(event))
    with pytest.raises(ValueError, match="history starts at"):
        led.output_integral_s(10.0, 70_000.0)
    assert led.output_integral_s(69_000.0, 70_000.0) == pytest.approx(5.0, rel=1e-3)


def test_micros_start_again_at_a_reset():
    clock = VirtualClock(start_s=100.0)
    board = SimulatedBoard(clock)
    clock.sleep_s(0.002)
    assert board.set_led(0, 100) == board.micros() == 2000
    board.receive(b"x")
    board.write(b"y")
    board.reset()
    assert (board.micros(), board.read(), board.take_output()) == (0, b"", b"")
    clock.sleep_s(0.01)
    assert board.output(0, clock.now_s()) < 1e-9


def test_unread_output_is_bounded_and_loses_whole_lines():
    board = SimulatedBoard(VirtualClock())
    for _ in range(10_000):
        board.write(b"OK 1,12345\n")
    output = board.take_output()
    assert len(output) <= 4096
    assert set(output.splitlines(keepends=True)) == {b"OK 1,12345\n"}


@pytest.mark.parametrize(
    "options",
    [
        *[{"led_count": 0}, {"serial_number": ""}, {"serial_number": "a,b"}],
        *[{"serial_number": "a b"}, {"serial_number": "\xe4"}, {"rise_ms": -1.0}],
        *[{"fall_ms": math.inf}, {"fall_ms": math.nan}],
        {"max_on_ms": 0},
    ],
)
def test_bad_options_are_refused(options):
    with pytest.raises(ValueError, match=r"led_count|serial number|rise_ms|fall_ms|max_on_ms"):
        SimulatedBoard(VirtualClock(), **options)


def test_strobe_edges_wait_in_order_and_are_bounded():
    board = SimulatedBoard(VirtualClock())
    board.strobe(True, 100e-6)
    board.strobe(False, 200e-6)
    assert board.strobe_edges() == [(100, True), (200, False)]
    assert board.strobe_edges() == []
    for edge in range(100):
        board.strobe(edge % 2 == 0, edge / 1e6)
    assert [at_us for at_us, _ in board.strobe_edges()] == list(range(STROBE_BUFFER_EDGES))
    board.strobe(True, 300e-6)
    board.reset()
    assert board.strobe_edges() == []


def test_a_trigger_reaches_the_camera_and_is_timed():
    clock = VirtualClock()
    board = SimulatedBoard(clock)
    board.trigger()
    pulses_s: list[float] = []
    board.on_trigger(lambda: pulses_s.append(clock.now_s()))
    clock.sleep_s(0.0025)
    assert board.trigger() == 2500
    assert pulses_s == [0.0025]
