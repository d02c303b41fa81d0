"""The firmware on a board without hardware, for MicroPython and CPython.

A request is a line of words; the reply is what a device that has just booted sends, in hexadecimal
digits. A word is bytes in hexadecimal digits, which take 1 ms a line; `@250`, a pause of 250
microseconds; `+` or `-`, the start or the end of an exposure; `*`, a part at the sensor. As in
`SimulatedController`, the firmware is polled every millisecond, and every POLL_US in a sequence.
"""

import sys

from firmware import Firmware

TICK_US = 1000
POLL_US = 100


class Board:
    led_count = 4
    serial_number = "SIM-0001"

    def __init__(self):
        self.now_us = 0
        self.arrived = self.sent = b""
        self.edges = []
        self.parts = []

    def micros(self):
        return self.now_us

    def read(self):
        data, self.arrived = self.arrived, b""
        return data

    def write(self, data):
        self.sent += data

    def set_led(self, index, percent):
        assert 0 <= index < self.led_count
        assert 0 <= percent <= 100
        return self.now_us

    def max_on_ms(self, index):
        return 120000

    def max_duty_percent(self, index):
        return 50

    def strobe_edges(self):
        edges, self.edges = self.edges, []
        return edges

    def part_edges(self):
        parts, self.parts = self.parts, []
        return parts

    def trigger(self):
        return self.now_us


class Device:
    def __init__(self):
        self.board = Board()
        self.firmware = Firmware(self.board)
        self._ticked_us = 0
        self._poll_us = None  # time of the next poll of a sequence

    def wait(self, duration_us):
        board = self.board
        deadline_us = board.now_us + duration_us
        while board.now_us < deadline_us:
            tick_us = min(deadline_us, self._ticked_us + TICK_US)
            if self._poll_us is not None and self._poll_us <= tick_us:
                board.now_us = self._poll_us
                self._poll_us = None
                self._poll()
            else:
                board.now_us = self._ticked_us = tick_us
                if self._poll_us is None:
                    self._poll()

    def take(self, word):
        """Return what the device sends for one word of a request."""
        if word.startswith("@"):
            self.wait(int(word[1:]))
        elif word in ("+", "-"):
            self.board.edges.append((self.board.now_us, word == "+"))
        elif word == "*":
            self.board.parts.append(self.board.now_us)
        else:
            data = bytes.fromhex(word)
            while data:
                end = data.find(b"\n") + 1
                if end:
                    self.wait(TICK_US)
                self._poll()
                self.board.arrived = data[:end] if end else data
                self._poll()
                data = data[end:] if end else b""
        sent, self.board.sent = self.board.sent, b""
        return sent

    def exercise(self):
        """Send a line of every kind."""
        for line in COMMANDS:
            self.take(line.hex())

    def _poll(self):
        self.firmware.poll()
        if self.firmware.sequence.running and self._poll_us is None:
            self._poll_us = self.board.now_us + POLL_US


def answer(request):
    """Return what a device sends during a request, its banner first."""
    device = Device()
    sent = device.take("")
    for word in request.split():
        sent += device.take(word)
    return sent


COMMANDS = (
    [b"*IDN?\n", b"LED:LEV 2,50\n", b"LED:SEL 2\n", b"#7 LED:SEL 2~E0\n", b"LED:STAT?\n"]
    + [b"HELLO\n", b"\xff\xff\n", b"x" * 300 + b"\n", b"LED:SEL 9\n", b"LED:OFF\n", b"\n"]
    + [b"SEQ:ARM 1000,50000,0,1,2,3,-1\n", b"SEQ:STAT?\n", b"LED:OFF\n", b"SEQ:STEP? 0\n"]
    + [b"PART:WAIT 0\n", b"SEQ:TRIG 1000,50000,0\n", b"PART:STAT?\n", b"LED:OFF\n"]
)


def main():
    while True:
        request = sys.stdin.readline()
        if not request:
            return
        print(answer(request).hex())


if __name__ == "__main__":
    main()
