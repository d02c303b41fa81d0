"""main.py and pico_board.py run under MicroPython and are used by the driver."""

import re
import time

import pytest
import serial

from rig.lights.driver import LightController

from .conftest import BOARD_FILES, DEADLINE_S

pytestmark = pytest.mark.micropython

FULL = 65535
LED_PINS = (2, 3, 4, 5)
TRIGGER_PIN = 7


@pytest.fixture
def line(pico):
    """The Pico's serial line after its banner."""
    with serial.Serial(pico.port, timeout=DEADLINE_S) as port:
        assert port.read_until(b"\n").startswith(b"READY PS4RIG,LED4,e66118604b842a21,")
        yield port


def ask(line, text: str) -> list[int]:
    line.write(text.encode() + b"\n")
    reply = line.read_until(b"\n").decode()
    assert reply.startswith("OK")
    return [int(field) for field in reply[3:].strip().split(",") if field]


def test_the_driver_switches_its_leds(pico):
    pico.wait_for("watchdog")
    with LightController(pico.port) as lights:
        assert lights.identity.serial_number == "e66118604b842a21"
        start = pico.mark()
        lights.set_level(2, 50)
        first, second = lights.select(3), lights.select(2)
        lights.off()
        assert 0 <= first.controller_time_us < second.controller_time_us
    pico.mark()
    lit = [(pin, duty) for pin, duty in pico.recorded("pwm", start) if duty]
    assert lit == [(LED_PINS[3], FULL), (LED_PINS[2], FULL // 2)]
    duties = dict(pico.recorded("pwm"))
    assert duties == dict.fromkeys(LED_PINS, 0)


def test_pins_are_low_before_anything_else(pico):
    pico.wait_for("watchdog")
    assert [(r["what"], r["number"], r["value"]) for r in pico.records[:4]] == [
        ("pin", pin, 0) for pin in LED_PINS
    ]
    assert all(value == 0 for _, value in pico.recorded("pin") + pico.recorded("pwm"))


def test_never_two_leds_at_once(pico, line):
    for led in (0, 1, 2, 3, 0):
        ask(line, f"LED:SEL {led}")
    ask(line, "LED:OFF")
    pico.mark()
    duties = {}
    for pin, duty in pico.recorded("pwm"):
        duties[pin] = duty
        assert sum(duty > 0 for duty in duties.values()) <= 1


def test_time_continues_when_the_counter_wraps(line):
    # the counter of board.mjs wraps 1 s after the start
    start_s = time.monotonic()
    times_us = [ask(line, "LED:STAT?")[-1]]
    first_s = time.monotonic()
    while time.monotonic() < first_s + 2.0:
        before_last_s = time.monotonic()
        times_us.append(ask(line, "LED:STAT?")[-1])
    end_s = time.monotonic()
    assert times_us == sorted(times_us)
    passed_s = (times_us[-1] - times_us[0]) / 1e6
    assert before_last_s - first_s - 0.01 < passed_s < end_s - start_s + 0.01


def test_control_characters_are_data(line):
    line.write(b"LED:SEL \x03\x01\x04 1\n")
    assert line.read_until(b"\n") == b'ERR -101,"Invalid character"\n'
    ask(line, "*RST")


def test_a_sequence_follows_the_strobe(pico, line):
    ask(line, "SEQ:ARM 1000,5000000,-1,0,1")
    for edge in ("strobe 0", "strobe 1") * 3:
        time.sleep(0.05)  # the LED has settled after 1 ms
        pico.send_event(edge)
        pico.mark()
    while (state := ask(line, "SEQ:STAT?"))[0]:
        pass
    assert state[:4] == [0, 3, 3, 0]
    for step, light in enumerate((-1, 0, 1)):
        led, lit_us, _, begun_us, ended_us, exposures = ask(line, f"SEQ:STEP? {step}")
        assert (led, exposures) == (light, 1)
        assert lit_us + 1000 <= begun_us
        assert ended_us - begun_us >= 50_000


def test_a_sequence_waits_for_the_part_sensor(pico, line):
    ask(line, "PART:WAIT 20000")
    ask(line, "SEQ:TRIG 1000,20000,0,1")
    time.sleep(0.1)
    assert ask(line, "SEQ:STAT?")[:2] == [1, 0]
    for _ in range(3):  # the contact bounces
        pico.send_event("part 0")
        pico.send_event("part 1")
    pico.mark()
    while (state := ask(line, "SEQ:STAT?"))[0]:
        pass
    assert state[:4] == [0, 2, 2, 0]
    parts, at_us, _ = ask(line, "PART:STAT?")
    assert parts == 1
    assert state[4] + ask(line, "SEQ:STEP? 0")[1] - at_us >= 20_000


def test_a_glitch_is_not_an_exposure(pico, line):
    ask(line, "SEQ:ARM 0,5000000,0,1")
    pico.send_event("glitch")
    pico.mark()
    assert ask(line, "SEQ:STAT?")[:2] == [1, 1]
    assert ask(line, "SEQ:STEP? 0")[-1] == 0


def test_too_many_edges_are_dropped(pico, line):
    ask(line, "SEQ:ARM 1000,5000000,0,1")
    for _ in range(200):
        pico.send_event("strobe 0")
        pico.send_event("strobe 1")
    pico.mark()
    ask(line, "*RST")


def test_a_trigger_is_a_pulse(pico, line):
    start = pico.mark()
    ask(line, "SEQ:TRIG 1000,20000,0,1")
    pico.wait_for("pin", 4, since=start)
    assert [level for pin, level in pico.recorded("pin") if pin == TRIGGER_PIN] == [0, 1, 0, 1, 0]


def test_a_fault_puts_the_leds_out_and_resets(pico, line):
    ask(line, "LED:SEL 1")
    start = pico.mark()
    pico.send_event("fail some text")
    assert line.read_until(b"\n") == b"FAULT OSError('some text',)\n"
    assert line.read_until(b"\n").startswith(b"READY ")
    before_reset = pico.records[start : [r["what"] for r in pico.records].index("reset")]
    assert {(r["number"], r["value"]) for r in before_reset} == {(pin, 0) for pin in LED_PINS}


def test_a_hang_ends_in_a_reset(pico, line):
    ask(line, "LED:SEL 1")
    pico.send_event("hang 3100")
    assert line.read_until(b"\n").startswith(b"READY ")
    assert pico.recorded("bite")


def test_a_host_that_does_not_read_blocks_nothing(pico, line):
    for _ in range(1000):  # far more replies than the board and the pseudo-terminal hold
        line.write(b"LED:STAT?\n")
    start = len(pico.records)
    line.write(b"LED:SEL 1\n")
    pico.wait_for("pwm", 4, since=start)
    assert not pico.recorded("bite")
    # then it reads complete lines, fewer than it asked for
    line.timeout = 1
    received = line.read(100_000)
    line.write(b"#1 LED:OFF\n")
    line.timeout = DEADLINE_S
    *replies, last = (received + line.read_until(b"#1 OK -1,")).splitlines()
    assert last == b"#1 OK -1,"
    assert 20 < len(replies) < 1000
    assert all(re.fullmatch(rb"OK (-1,100,100,100,100|1),\d+", reply) for reply in replies)


def test_prog_gives_the_prompt_for_one_boot(pico, line):
    ask(line, "LED:SEL 1")
    ask(line, "SYST:PROG")
    pico.wait_for("reset")
    assert dict(pico.recorded("pin"))[3] == 0
    with pico.prompt() as execute:
        assert execute("import os; print('prompt-once' in os.listdir())") == "False"
        assert (
            len(pico.recorded("watchdog")) == 1
        )  # none that resets the board while files are copied
        line.write(b"import machine; machine.reset()\x04")
        line.read_until(b"READY ")


@pytest.mark.parametrize("name", ["firmware.py", "pico_board.py"])
def test_a_broken_file_leads_to_the_prompt(new_pico, name, tmp_path):
    broken = tmp_path / name
    broken.write_text("this is (no program\n")
    pico = new_pico(*BOARD_FILES, broken)
    with pico.prompt() as execute:
        assert execute("print(6 * 7)") == "42"
    assert not pico.recorded("watchdog")
    assert all(value == 0 for _, value in pico.recorded("pin") + pico.recorded("pwm"))
