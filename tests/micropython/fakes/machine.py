"""The hardware of a Pico that the board file uses; outputs are recorded."""

import json
import time

import host

TIMERS = []  # running timers
PINS = {}  # pins with an interrupt, by number


def record(what, number, value):
    host.record(json.dumps({"what": what, "number": number, "value": value}))


def run_hardware():
    """Run timers and events; called between two steps of the program."""
    for timer in list(TIMERS):
        timer._run()
    text = host.event()
    while text:
        name, _, argument = text.partition(" ")
        EVENTS[name](argument)
        text = host.event()


class Pin:
    IN = 0
    OUT = 1
    PULL_UP = 1
    IRQ_RISING = 8
    IRQ_FALLING = 4

    def __init__(self, number, mode=None, pull=None, value=None):
        self.number = number
        if mode == Pin.OUT:
            record("pin", number, value)

    def value(self):
        return INPUTS.get(self.number, 1)  # pulled up

    def on(self):
        record("pin", self.number, 1)

    def off(self):
        record("pin", self.number, 0)

    def irq(self, handler, trigger, hard):
        assert hard
        assert trigger == Pin.IRQ_RISING | Pin.IRQ_FALLING
        self.handler = handler
        PINS[self.number] = self


class PWM:
    def __init__(self, pin, freq, duty_u16):
        self.pin = pin
        self.freq = freq
        self.duty_u16(duty_u16)

    def duty_u16(self, duty):
        assert 0 <= duty <= 65535
        record("pwm", self.pin.number, duty)


class Timer:
    ONE_SHOT = 0

    def init(self, mode, period, callback):
        assert mode == Timer.ONE_SHOT
        self.callback = callback
        self.due_ms = time.ticks_add(time.ticks_ms(), period)
        TIMERS.append(self)

    def _run(self):
        if time.ticks_diff(time.ticks_ms(), self.due_ms) >= 0:
            TIMERS.remove(self)
            self.callback(self)


class WDT:
    def __init__(self, timeout):
        self.timeout = timeout
        self.fed_ms = time.ticks_ms()
        record("watchdog", 0, timeout)

    def feed(self):
        # a real one bites during the hang, this one at its end
        if time.ticks_diff(time.ticks_ms(), self.fed_ms) >= self.timeout:
            record("bite", 0, 1)
            reset()
        self.fed_ms = time.ticks_ms()


def reset():
    record("reset", 0, 1)
    host.reset()
    raise SystemExit


def unique_id():
    return b"\xe6\x61\x18\x60\x4b\x84\x2a\x21"


def disable_irq():
    return 0


def enable_irq(state):
    pass


def _strobe(level):
    _set(6, level)


def _part(level):
    _set(9, level)


def _set(number, level):
    INPUTS[number] = int(level)
    pin = PINS.get(number)
    if pin:
        pin.handler(pin)


def _glitch(_):
    time.held_us = time.ticks_us()
    _strobe(0)
    _strobe(1)
    time.held_us = None


def _hang(ms):
    time.sleep_ms(int(ms))


def _fail(text):
    raise OSError(text)


def _mark(_):
    record("mark", 0, 0)


INPUTS = {}
EVENTS = {
    "mark": _mark,
    "strobe": _strobe,
    "part": _part,
    "glitch": _glitch,
    "hang": _hang,
    "fail": _fail,
}
