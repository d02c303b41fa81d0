"""Sequences: exposures that count, events that end one, times in the record; LED limits."""

from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

SETTLE_US = 2000


@dataclass(frozen=True)
class Run:
    """A device that runs a sequence, and a camera that exposes."""

    device: object
    start_us: int

    def expose(self, pause_us: int, exposure_us: int = 10_000) -> None:
        for passed_us, exposing in ((pause_us, True), (exposure_us, False)):
            self.device.clock.sleep_s(passed_us / 1e6)
            self.device.strobe(exposing)

    def steps(self) -> list[list[int]]:
        _, begun, *_ = self.device.ask("SEQ:STAT?")
        return [self.device.ask(f"SEQ:STEP? {index}") for index in range(begun)]

    @property
    def code(self) -> int:
        return self.device.ask("SEQ:STAT?")[3]

    @property
    def running(self) -> bool:
        return bool(self.device.ask("SEQ:STAT?")[0])


def begin(device, command: str) -> Run:
    (start_us,) = device.ask(command)
    return Run(device, start_us)


def arm(device, *lights: int, timeout_us: int = 100_000) -> Run:
    return begin(device, f"SEQ:ARM {SETTLE_US},{timeout_us},{','.join(map(str, lights))}")


def test_each_light_gets_one_exposure_and_the_leds_are_off_afterwards(device):
    run = arm(device, -1, 0, 1, 2, 3)
    for _ in range(5):
        run.expose(pause_us=5000)
    assert device.lit() == [0.0] * 4
    assert not run.running
    steps = run.steps()
    assert [step[0] for step in steps] == [-1, 0, 1, 2, 3]
    for index, (_, lit_us, triggered_us, begun_us, ended_us, exposures) in enumerate(steps):
        assert begun_us == 5000 + 15_000 * index
        assert ended_us == begun_us + 10_000
        assert (triggered_us, exposures) == (-1, 1)
        if index:
            assert 0 < lit_us - steps[index - 1][4] <= 200  # one pass of the main loop
    passed_us = device.ask("SEQ:STAT?")[5]
    assert 0 < passed_us - steps[-1][4] <= 200


def test_an_exposure_that_runs_at_the_start_does_not_count(device):
    device.strobe(True)
    device.clock.sleep_s(0.001)
    run = arm(device, 0, 1)
    device.clock.sleep_s(0.005)
    device.strobe(False)
    run.expose(pause_us=5000)
    run.expose(pause_us=5000)
    assert [step[3:] for step in run.steps()] == [[10_000, 20_000, 1], [25_000, 35_000, 1]]


def test_an_exposure_before_the_light_has_settled_does_not_count(device):
    run = arm(device, 0, 1, timeout_us=50_000)
    run.expose(pause_us=SETTLE_US - 500)  # too early
    run.expose(pause_us=1000)
    run.expose(pause_us=1000)  # too early after light 1 was lit
    run.expose(pause_us=1000)
    assert [step[3:] for step in run.steps()] == [[12_500, 22_500, 2], [34_500, 44_500, 2]]


def test_edges_from_before_the_start_are_ignored(device):
    device.strobe(True)
    run = arm(device, 0)
    device.board.strobe(False, (run.start_us - 1) / 1e6)
    device.clock.sleep_s(0.01)
    assert run.steps() == [[0, 0, -1, -1, -1, 0]]


def test_a_busy_loop_is_late_but_counts_correctly(new_device):
    device = new_device(pass_us=(20_000.0, 20_000.0))
    run = arm(device, 0, 1, timeout_us=1_000_000)
    for _ in range(8):
        run.expose(pause_us=1000, exposure_us=4000)
    device.clock.sleep_s(0.1)
    first, second = run.steps()
    assert first[3] == 6000  # the exposure at 1000 us began too early
    assert second[1] == 20_000
    assert second[3] < 0 or second[3] - second[1] >= SETTLE_US


@pytest.mark.parametrize(
    "command", ["LED:SEL 2", "LED:LEV 0,50", "SEQ:ARM 0,1000,0", "SEQ:TRIG 0,1000,0"]
)
def test_commands_that_would_disturb_a_sequence_are_refused(device, command):
    run = arm(device, 0, 1)
    reply = device.exchange(command.encode() + b"\n")
    assert reply == b'ERR 120,"Sequence is running"\n'
    run.expose(pause_us=5000)
    run.expose(pause_us=5000)
    assert (run.running, run.code) == (False, 0)


@pytest.mark.parametrize(("command", "code"), [("LED:OFF", 122), ("*RST", 0)])
def test_commands_that_put_leds_out_end_a_sequence(device, command, code):
    run = arm(device, 0, 1)
    assert device.lit() == [1.0, 0.0, 0.0, 0.0]
    assert device.exchange(command.encode() + b"\n").startswith(b"OK")
    assert device.lit() == [0.0] * 4
    assert (run.running, run.code) == (False, code)
    run.expose(pause_us=5000)
    assert device.lit() == [0.0] * 4
    assert device.exchange(b"SYST:ERR?\n") == b'OK 0,"No error"\n'


@pytest.mark.parametrize("edges", [0, 1, 2, 3])
def test_a_strobe_that_stops_puts_the_leds_out(device, edges):
    run = arm(device, 0, 1)
    for edge in range(edges):
        device.clock.sleep_s(0.005)
        device.strobe(edge % 2 == 0)
    device.clock.sleep_s(0.090)
    assert run.running
    device.clock.sleep_s(0.012)
    assert device.lit() == [0.0] * 4
    assert (run.running, run.code) == (False, 121)
    assert device.exchange(b"SYST:ERR?\n") == b'OK 121,"Strobe missing: LEDs off"\n'
    assert device.exchange(b"SYST:ERR?\n") == b'OK 0,"No error"\n'


def test_the_watchdog_ends_a_sequence_even_in_a_dark_step(device):
    device.exchange(b"SYST:WDOG 100\n")
    run = arm(device, -1, 0, timeout_us=10_000_000)
    device.clock.sleep_s(0.110)
    assert (run.running, run.code) == (False, 100)
    assert device.exchange(b"SYST:ERR?\n") == b'OK 100,"Watchdog: LEDs off"\n'


def test_a_timed_sequence_triggers_each_exposure(device):
    pulses_s: list[float] = []
    device.board.on_trigger(lambda: pulses_s.append(device.clock.now_s()))
    run = begin(device, f"SEQ:TRIG {SETTLE_US},20000,-1,3,0")
    device.clock.sleep_s(0.070)
    assert (run.running, run.code) == (False, 0)
    steps = run.steps()
    assert [step[0] for step in steps] == [-1, 3, 0]
    for index, ((_, lit_us, triggered_us, *_), pulse_s) in enumerate(
        zip(steps, pulses_s, strict=True)
    ):
        assert 0 <= lit_us - 20_000 * index <= 400 * index
        assert 0 <= triggered_us - lit_us - SETTLE_US <= 200
        assert round(1e6 * pulse_s) == run.start_us + triggered_us


def test_triggers_are_never_closer_than_the_interval(new_device):
    device = new_device(pass_us=(50.0, 5000.0))
    run = begin(device, f"SEQ:TRIG {SETTLE_US},20000,0,1,2,3,0,1,2,3")
    device.clock.sleep_s(0.3)
    triggers_us = [step[2] for step in run.steps()]
    assert all(after - before >= 20_000 for before, after in pairwise(triggers_us))


def test_a_timed_sequence_records_the_strobe(device):
    run = begin(device, f"SEQ:TRIG {SETTLE_US},20000,1,2")
    for _ in range(2):
        run.expose(pause_us=4000, exposure_us=10_000)
        device.clock.sleep_s(0.006)
    assert [step[3:] for step in run.steps()] == [[4000, 14_000, 1], [24_000, 34_000, 1]]


def test_the_record_of_a_sequence_stays_until_the_next(device):
    run = arm(device, 0)
    run.expose(pause_us=5000)
    device.exchange(b"LED:SEL 1\n")
    assert len(run.steps()) == 1
    second = arm(device, 2, 3)
    assert [step[0] for step in second.steps()] == [2]


@settings(deadline=None)  # many passes of the main loop
@given(
    timing=st.lists(
        st.tuples(st.integers(100, 9000), st.integers(100, 9000)), min_size=1, max_size=16
    ),
    lights=st.lists(st.integers(-1, 3), min_size=1, max_size=16),
)
def test_an_exposure_counts_only_under_one_settled_light(new_device, timing, lights):
    device = new_device()
    run = arm(device, *lights)
    light_changes_us: list[int] = []
    for pause_us, exposure_us in timing:
        run.expose(pause_us, exposure_us)
    device.clock.sleep_s(0.001)
    steps = run.steps()
    light_changes_us = [step[1] for step in steps] + [device.ask("SEQ:STAT?")[5]]
    assert [step[0] for step in steps] == lights[: len(steps)]
    for index, (_, lit_us, _, begun_us, ended_us, _) in enumerate(steps):
        if begun_us >= 0:
            assert begun_us - lit_us >= SETTLE_US
            if ended_us >= 0:
                assert ended_us <= light_changes_us[index + 1]


# Limits of the LEDs


def test_keep_alive_commands_do_not_extend_the_time_limit_of_an_led(new_device):
    device = new_device(max_on_ms=1000)
    device.exchange(b"SYST:WDOG 200\nLED:SEL 1\n")
    for _ in range(9):
        device.clock.sleep_s(0.1)
        assert device.exchange(b"LED:STAT?\n").startswith(b"OK 1,")
    device.clock.sleep_s(0.1)
    assert device.exchange(b"LED:STAT?\n").startswith(b"OK -1,")
    assert device.exchange(b"SYST:ERR?\n") == b'OK 110,"On-time limit: LEDs off"\n'
    assert device.exchange(b"*RST\nLED:SEL 1\n").endswith(b'ERR 111,"LED must rest"\n')
    assert device.exchange(b"SEQ:ARM 0,1000,0,1\n") == b'ERR 111,"LED must rest"\n'
    assert device.exchange(b"LED:SEL 2\n").startswith(b"OK 2,")
    device.exchange(b"LED:OFF\n")
    device.clock.sleep_s(0.5)
    assert device.exchange(b"LED:SEL 1\n").startswith(b"OK 1,")


def test_the_duty_limit_holds_in_the_long_run(new_device):
    device = new_device(max_on_ms=200)
    start_s = device.clock.now_s()
    while device.clock.now_s() - start_s < 5.0:
        device.exchange(b"LED:SEL 0\n")
        device.clock.sleep_s(0.030)
        device.exchange(b"LED:OFF\n")
        device.clock.sleep_s(0.005)
    end_s = device.clock.now_s()
    lit_s = device.board.output_integral_s(0, start_s, end_s)
    assert 0.9 * 0.5 * (end_s - start_s) < lit_s < 0.2 + 0.5 * (end_s - start_s)


def test_selecting_an_led_again_does_not_refill_its_budget(new_device):
    device = new_device(max_on_ms=1000)
    for _ in range(9):
        assert device.exchange(b"LED:SEL 0\n").startswith(b"OK")
        device.clock.sleep_s(0.1)
    device.clock.sleep_s(0.1)
    assert device.exchange(b"SYST:ERR?\n") == b'OK 110,"On-time limit: LEDs off"\n'


def test_the_time_limit_of_an_led_ends_a_sequence(new_device):
    device = new_device(max_on_ms=1000)
    device.exchange(b"LED:SEL 0\n")
    device.clock.sleep_s(0.4)
    run = arm(device, 0, timeout_us=60_000_000)
    device.clock.sleep_s(0.59)
    assert run.running
    device.clock.sleep_s(0.02)
    assert (run.running, run.code) == (False, 110)
    assert device.lit() == [0.0] * 4


def test_the_mean_of_1024_frames_under_each_light_is_within_the_limits(device):
    device.exchange(b"SYST:WDOG 60000\n")
    for led in range(4):
        assert device.exchange(b"LED:SEL %d\n" % led).startswith(b"OK")
        device.clock.sleep_s(1024 / 30)
        assert device.exchange(b"LED:STAT?\n").startswith(b"OK %d," % led)
