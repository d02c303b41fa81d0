"""Simulated faults of lines and LEDs have the documented effects at the given times."""

import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import SimulatedBoard, VirtualClock
from firmware_sim.board import Led
from firmware_sim.faults import FaultyLine, LedFault, LineFault, When, faulty_leds


def line_with(*faults: LineFault, seed: int = 1) -> FaultyLine:
    clock = VirtualClock()
    line = FaultyLine(SimulatedBoard(clock), clock, faults, seed)
    line.connect()
    return line


def replies_to(line: FaultyLine, data: bytes) -> list[bytes]:
    line.feed(data)
    return line.take_output().splitlines()


# When


def test_nth_and_times_count_events_from_one() -> None:
    when = When(nth=2, times=3)
    rng = random.Random(1)
    assert [n for n in range(1, 9) if when.affects(n, rng)] == [2, 3, 4]


def test_a_probability_applies_to_each_event() -> None:
    rng = random.Random(1)
    assert 250 < sum(When(probability=0.3).affects(n, rng) for n in range(1000)) < 350


@pytest.mark.parametrize(
    "fields", [{"nth": 0}, {"times": 0}, {"probability": 0.0}, {"from_s": 2.0, "until_s": 1.0}]
)
def test_impossible_conditions_are_refused(fields: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(fields))):
        When(**fields)  # type: ignore[arg-type]


# Lines


def test_a_line_without_faults_is_not_changed() -> None:
    assert replies_to(line_with(), b"LED:LEV 2,50\nLED:LEV? 2\n") == [b"OK 2,50", b"OK 2,50"]


def test_a_command_with_a_lost_reply_is_executed_and_a_lost_one_is_not() -> None:
    only = When(nth=1)
    lost = line_with(LineFault(kind="lose", containing="LED:LEV 2", when=only))
    assert replies_to(lost, b"LED:LEV 2,50\nLED:LEV? 2\n") == [b"OK 2,100"]
    unheard = line_with(
        LineFault(kind="lose", direction="to_host", containing="LED:LEV 2", when=only)
    )
    assert replies_to(unheard, b"LED:LEV 2,50\nLED:LEV? 2\n") == [b"OK 2,50"]


def test_a_late_line_comes_before_the_next_one() -> None:
    late = line_with(LineFault(kind="late", direction="to_host", containing="LEV? 1"))
    assert replies_to(late, b"LED:LEV? 1\n") == []
    assert replies_to(late, b"LED:LEV? 2\n") == [b"OK 1,100", b"OK 2,100"]


def test_a_doubled_command_is_executed_twice() -> None:
    assert replies_to(line_with(LineFault(kind="double")), b"SYST:WDOG?\n") == [b"OK 5000"] * 2


def test_a_truncated_command_runs_into_the_next() -> None:
    replies = replies_to(
        line_with(LineFault(kind="truncate", when=When(nth=1))), b"LED:OFF\nLED:OFF\n"
    )
    assert len(replies) == 1
    assert replies != [b"OK -1,2000"]


def test_a_delayed_line_takes_longer_by_its_delay() -> None:
    (reply,) = replies_to(line_with(LineFault(kind="delay", delay_ms=40)), b"LED:SEL 1\n")
    assert reply == b"OK 1,41000"


def test_a_reboot_puts_the_leds_out_and_sends_a_banner() -> None:
    line = line_with(LineFault(kind="reboot", containing="STAT"))
    assert replies_to(line, b"LED:SEL 1\nLED:STAT?\n")[1:] == []
    line.clock.sleep_s(0.4)
    line.poll()
    assert line.take_output().startswith(b"READY ")
    assert replies_to(line, b"led:stat?\n")[0].startswith(b"OK -1,")


@given(
    kind=st.sampled_from(["garble", "lose_byte", "double_byte", "truncate"]),
    seed=st.integers(0, 999),
)
def test_damage_changes_a_line_and_is_repeatable_by_seed(kind: str, seed: int) -> None:
    def replies() -> list[bytes]:
        line = line_with(LineFault(kind=kind, direction="to_host"), seed=seed)  # type: ignore[arg-type]
        return replies_to(line, b"LED:LEV? 2\n" * 3)

    damaged = replies()
    assert damaged == replies()
    assert damaged != [b"OK 2,100"] * 3


# LEDs


def light_of(*faults: LedFault) -> Callable[[int, float, float], float]:
    """Output of a board with LED 1 on from 1 s: mean over an interval."""
    clock = VirtualClock()
    leds = [Led(0.0, 0.0) for _ in range(4)]
    board = SimulatedBoard(clock, leds=faulty_leds(leds, faults, 1, 0.0))
    clock.sleep_s(1.0)
    board.set_led(1, 100)
    clock.sleep_s(4.0)
    return lambda led, start_s, end_s: (
        board.output_integral_s(led, start_s, end_s) / (end_s - start_s)
    )


def test_dim_and_dead_leds_give_less_during_their_time() -> None:
    dim = light_of(LedFault(kind="dim", led=1, share=0.3, from_s=2.0, until_s=3.0))
    assert dim(1, 2.2, 2.4) == pytest.approx(0.7)
    assert dim(1, 3.2, 3.4) == pytest.approx(1.0)
    assert dim(1, 2.9, 3.1) == pytest.approx(0.85)
    assert light_of(LedFault(kind="dead", led=1))(1, 1.0, 2.0) == 0.0


def test_an_led_that_is_stuck_on_never_gives_less_than_its_share() -> None:
    stuck = light_of(
        LedFault(kind="stuck_on", led=0, share=0.2), LedFault(kind="stuck_on", led=1, share=0.2)
    )
    assert stuck(0, 0.2, 0.4) == pytest.approx(0.2)
    assert stuck(1, 0.2, 0.4) == pytest.approx(0.2)
    assert stuck(1, 2.2, 2.4) == pytest.approx(1.0)


def test_flicker_is_a_sine() -> None:
    flicker = light_of(LedFault(kind="flicker", led=1, share=0.4, frequency_hz=10.0))
    assert flicker(1, 2.0, 2.1) == pytest.approx(0.8, abs=1e-3)
    assert flicker(1, 2.024, 2.026) == pytest.approx(0.6, abs=1e-3)
    assert flicker(1, 2.074, 2.076) == pytest.approx(1.0, abs=1e-3)


def test_an_unsteady_led_is_constant_within_a_slot() -> None:
    unsteady = light_of(LedFault(kind="unsteady", led=1, share=0.5, frequency_hz=10.0))
    slots = [unsteady(1, 2.0 + 0.1 * n + 0.01, 2.0 + 0.1 * n + 0.02) for n in range(20)]
    assert min(slots) < 0.65
    assert max(slots) > 0.85
    assert unsteady(1, 2.01, 2.02) == pytest.approx(unsteady(1, 2.07, 2.08))


def test_swapped_leds_light_in_each_others_places() -> None:
    swapped = light_of(LedFault(kind="swapped", led=1, other=3))
    assert swapped(1, 2.0, 2.1) == 0.0
    assert swapped(3, 2.0, 2.1) == pytest.approx(1.0)
