"""The part sensor: a sequence that starts when a part arrives, and the count of parts."""

from hypothesis import given, settings
from hypothesis import strategies as st


def arm(device, delay_us: int, command: str = "SEQ:TRIG 2000,30000,-1,2") -> int:
    assert device.ask(f"PART:WAIT {delay_us}") == [delay_us]
    return device.ask(command)[0]


@settings(max_examples=30, deadline=None)
@given(delay_us=st.integers(0, 50_000), arrives_us=st.integers(0, 500_000))
def test_the_first_light_is_lit_the_delay_after_the_part(new_device, delay_us, arrives_us):
    device = new_device()
    started_us = arm(device, delay_us, "SEQ:TRIG 2000,30000,2,-1")
    device.clock.sleep_s(arrives_us / 1e6)
    assert device.lit() == [0.0] * 4
    seen_s = device.clock.now_s()
    device.see_part()
    device.clock.sleep_s(0.2)
    lit_us = started_us + device.ask("SEQ:STEP? 0")[1]
    assert 0 <= lit_us - (seen_s * 1e6 + delay_us) <= 201  # one pass of the main loop
    assert device.ask("SEQ:STAT?")[:4] == [0, 2, 2, 0]


def test_a_waiting_sequence_is_dark_runs_and_refuses_what_would_disturb_it(device):
    arm(device, 1000)
    device.clock.sleep_s(1.0)
    assert device.ask("SEQ:STAT?")[:4] == [1, 0, 2, 0]
    for command in (b"LED:SEL 2\n", b"PART:WAIT 0\n", b"SEQ:ARM 0,1000,0\n"):
        assert device.exchange(command) == b'ERR 120,"Sequence is running"\n'
    assert device.lit() == [0.0] * 4


def test_a_part_before_the_sequence_does_not_start_it(device):
    device.see_part()
    arm(device, 0)
    device.clock.sleep_s(0.5)
    assert device.ask("SEQ:STAT?")[:2] == [1, 0]


def test_only_the_first_part_starts_the_sequence(device):
    arm(device, 20_000)
    for _ in range(3):
        device.see_part()
        device.clock.sleep_s(0.01)
    device.clock.sleep_s(0.2)
    assert device.ask("SEQ:STAT?")[:4] == [0, 2, 2, 0]
    assert device.ask("PART:STAT?")[0] == 3


def test_only_the_next_sequence_waits(device):
    arm(device, 0)
    device.see_part()
    device.clock.sleep_s(0.2)
    device.ask("SEQ:TRIG 2000,30000,1")
    device.clock.sleep_s(0.1)
    assert device.ask("SEQ:STAT?")[:4] == [0, 1, 1, 0]


def test_the_strobe_counts_from_the_first_light_and_its_time_out_too(device):
    arm(device, 0, "SEQ:ARM 2000,100000,0")
    for _ in range(20):  # a camera that runs freely
        device.strobe(True)
        device.clock.sleep_s(0.02)
        device.strobe(False)
        device.clock.sleep_s(0.01)
    device.see_part()
    device.clock.sleep_s(0.005)
    device.strobe(True)
    device.clock.sleep_s(0.02)
    device.strobe(False)
    device.clock.sleep_s(0.01)
    assert device.ask("SEQ:STAT?")[:4] == [0, 1, 1, 0]
    light, lit_us, _, begun_us, ended_us, exposures = device.ask("SEQ:STEP? 0")
    assert (light, exposures) == (0, 1)
    assert 4800 <= begun_us - lit_us <= 5000
    assert ended_us - begun_us == 20_000


def test_a_waiting_sequence_ends_by_the_watchdog_and_by_led_off(device):
    arm(device, 0)
    device.clock.sleep_s(6.0)
    assert device.ask("SEQ:STAT?")[:4] == [0, 0, 2, 100]
    arm(device, 0)
    assert device.exchange(b"LED:OFF\n").startswith(b"OK -1,")
    device.see_part()
    device.clock.sleep_s(0.1)
    assert device.ask("SEQ:STAT?")[:4] == [0, 0, 2, 122]


def test_a_reset_forgets_the_delay(device):
    device.ask("PART:WAIT 0")
    device.exchange(b"*RST\n")
    device.ask("SEQ:TRIG 2000,30000,1")
    assert device.ask("SEQ:STAT?")[1] == 1


def test_parts_are_counted_with_the_time_of_the_latest(device):
    assert device.ask("PART:STAT?")[:2] == [0, -1]
    for _ in range(2):
        device.clock.sleep_s(0.1)
        device.see_part()
    latest_us = round(device.clock.now_s() * 1e6)
    assert device.ask("PART:STAT?")[:2] == [2, latest_us]
