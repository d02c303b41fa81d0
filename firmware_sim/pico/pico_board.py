"""The Raspberry Pi Pico as a `firmware_sim.board.Board`.

LEDs, strobe, trigger and part sensor are on its pins. For MicroPython on RP2040 and RP2350.
README.md describes the wiring; change both together.
"""

import sys
from array import array
from binascii import hexlify
from select import POLLIN, POLLOUT, poll
from time import ticks_diff, ticks_us  # type: ignore[attr-defined]

from firmware import STROBE_BUFFER_EDGES
from machine import PWM, Pin, Timer, disable_irq, enable_irq, unique_id

LED_PINS = (2, 3, 4, 5)
STROBE_PIN = 6
TRIGGER_PIN = 7
PART_PIN = 9
# Limits of each LED; README.md gives the reasons.
MAX_ON_MS = (120000, 120000, 120000, 120000)
MAX_DUTY_PERCENT = (50, 50, 50, 50)

_PWM_HZ = 100000  # many periods in an exposure; at 100 % the LED is on without modulation
_PULSE_MS = 1  # the timer ends the pulse after 1 to 2 ms
_GLITCH_US = 20  # two edges closer than this are noise
_BOUNCE_US = 20000  # a part sensor's contact bounces for up to 10 ms
_READ_BYTES = 64  # at most in one pass: about one line
_OUTPUT_BYTES = 1024  # buffer for a host that does not read; about 25 replies
_USB_PACKET_BYTES = 64


def darken() -> None:
    """Drive all LED pins low."""
    for pin in LED_PINS:
        Pin(pin, Pin.OUT, value=0)


class _Edges:
    """The times of edges of an input that is low when active; its interrupt must not allocate."""

    def __init__(self, pin: int) -> None:
        self._ticks = array("l", [0] * STROBE_BUFFER_EDGES)
        self._levels = bytearray(STROBE_BUFFER_EDGES)
        self._count = 0
        self._pin = Pin(pin, Pin.IN, Pin.PULL_UP)
        self._pin.irq(self._edge, Pin.IRQ_RISING | Pin.IRQ_FALLING, hard=True)

    def take(self) -> list[tuple[int, bool]]:
        """The edges since the last call, as (ticks_us, active), oldest first."""
        count = self._count
        # The last edge may be one side of a glitch; the interrupt does not change the others.
        if count and ticks_diff(ticks_us(), self._ticks[count - 1]) < _GLITCH_US:
            count -= 1
        edges = [(self._ticks[i], self._levels[i] == 0) for i in range(count)]
        if count:
            interrupts = disable_irq()
            self._count -= count
            for i in range(self._count):
                self._ticks[i] = self._ticks[i + count]
                self._levels[i] = self._levels[i + count]
            enable_irq(interrupts)
        return edges

    def _edge(self, pin: Pin) -> None:
        now = ticks_us()
        count = self._count
        if count and ticks_diff(now, self._ticks[count - 1]) < _GLITCH_US:
            self._count = count - 1
        elif count < STROBE_BUFFER_EDGES:
            self._ticks[count] = now
            self._levels[count] = pin.value()
            self._count = count + 1


class PicoBoard:
    """Pins, clock and USB serial line of one Pico; construction puts the LEDs out."""

    led_count = len(LED_PINS)

    def __init__(self) -> None:
        darken()
        # The serial number of the USB device, so that ports and identities can be matched.
        self.serial_number = hexlify(unique_id()).decode()
        self._leds = [PWM(Pin(pin), freq=_PWM_HZ, duty_u16=0) for pin in LED_PINS]
        self._trigger = Pin(TRIGGER_PIN, Pin.OUT, value=0)
        self._pulse = Timer()
        self._strobe = _Edges(STROBE_PIN)
        self._part = _Edges(PART_PIN)
        self._part_us = -_BOUNCE_US  # the latest edge of the part sensor
        self._ticks = ticks_us()
        self._micros = 0
        self._input_poll = poll()
        self._input_poll.register(sys.stdin, POLLIN)
        self._output_poll = poll()
        self._output_poll.register(sys.stdout, POLLOUT)
        self._unsent = b""

    def micros(self) -> int:
        now = ticks_us()
        self._micros += ticks_diff(now, self._ticks)
        self._ticks = now
        return self._micros

    def read(self) -> bytes:
        self.micros()  # at least once per pass, or a wrap would be missed
        self._send()
        data = b""
        while self._input_poll.poll(0) and len(data) < _READ_BYTES:
            data += sys.stdin.buffer.read(1)
        return data

    def write(self, data: bytes) -> None:
        # A host that never reads loses whole lines; memory stays bounded.
        if len(self._unsent) + len(data) <= _OUTPUT_BYTES:
            self._unsent += data
        self._send()

    def set_led(self, index: int, percent: int) -> int:
        self._leds[index].duty_u16(65535 * percent // 100)
        return self.micros()

    def max_on_ms(self, index: int) -> int:
        return MAX_ON_MS[index]

    def max_duty_percent(self, index: int) -> int:
        return MAX_DUTY_PERCENT[index]

    def strobe_edges(self) -> list[tuple[int, bool]]:
        return self._timed(self._strobe)

    def part_edges(self) -> list[int]:
        parts_us = []
        for at_us, active in self._timed(self._part):
            if active and at_us - self._part_us >= _BOUNCE_US:
                parts_us.append(at_us)
            self._part_us = at_us
        return parts_us

    def trigger(self) -> int:
        self._trigger.on()
        began_us = self.micros()
        self._pulse.init(mode=Timer.ONE_SHOT, period=_PULSE_MS, callback=self._end_pulse)
        return began_us

    def _timed(self, line: _Edges) -> list[tuple[int, bool]]:
        edges = line.take()
        if not edges:
            return edges
        now_us = self.micros()
        return [(now_us + ticks_diff(at, self._ticks), active) for at, active in edges]

    def _end_pulse(self, _: Timer) -> None:
        self._trigger.off()

    def _send(self) -> None:
        # Without a host MicroPython discards the bytes. With a host that stops reading it waits for
        # room in the middle of a packet, three times half a second, and then gives up.
        while self._unsent and self._output_poll.poll(0):
            packet = self._unsent[:_USB_PACKET_BYTES]
            sent = sys.stdout.buffer.write(packet)
            self._unsent = self._unsent[sent:]
            if sent < len(packet):
                return
