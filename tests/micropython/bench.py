"""The firmware on a board of numbers, the same under MicroPython and CPython.

Each request is a line of words, each reply what a device that has just booted sent, in hexadecimal
digits. A word is bytes in hexadecimal digits, which take 1 ms a line; `@250`, time that passes, in
microseconds; `+` or `-`, the beginning or the end of an exposure. Time passes as for a
`SimulatedController`: the firmware has a turn each millisecond, and each TURN_US in a sequence.
"""

import sys

from firmware import Firmware

TICK_US = 1000
TURN_US = 100


class Board:
    led_count = 4
    serial_number = "SIM-0001"

    def __init__(self):
        self.now_us = 0
        self.arrived = self.sent = b""
        self.edges = []

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

    def trigger(self):
        return self.now_us


class Device:
    def __init__(self):
        self.board = Board()
        self.firmware = Firmware(self.board)
        self._ticked_us = 0
        self._turn_us = None  # when a sequence's next turn is

    def wait(self, duration_us):
        board = self.board
        deadline_us = board.now_us + duration_us
        while board.now_us < deadline_us:
            tick_us = min(deadline_us, self._ticked_us + TICK_US)
            if self._turn_us is not None and self._turn_us <= tick_us:
                board.now_us = self._turn_us
                self._turn_us = None
                self._turn()
            else:
                board.now_us = self._ticked_us = tick_us
                if self._turn_us is None:
                    self._turn()

    def take(self, word):
        """What one word of a request makes the device send."""
        if word.startswith("@"):
            self.wait(int(word[1:]))
        elif word in ("+", "-"):
            self.board.edges.append((self.board.now_us, word == "+"))
        else:
            data = bytes.fromhex(word)
            while data:
                end = data.find(b"\n") + 1
                if end:
                    self.wait(TICK_US)
                self._turn()
                self.board.arrived = data[:end] if end else data
                self._turn()
                data = data[end:] if end else b""
        sent, self.board.sent = self.board.sent, b""
        return sent

    def exercise(self):
        """Take a line of every kind."""
        for line in COMMANDS:
            self.take(line.hex())

    def _turn(self):
        self.firmware.poll()
        if self.firmware.sequence.running and self._turn_us is None:
            self._turn_us = self.board.now_us + TURN_US


def answer(request):
    """What a device sends in the course of a request, its banner first."""
    device = Device()
    sent = device.take("")
    for word in request.split():
        sent += device.take(word)
    return sent


COMMANDS = (
    [b"*IDN?\n", b"LED:LEV 2,50\n", b"LED:SEL 2\n", b"#7 LED:SEL 2~E0\n", b"LED:STAT?\n"]
    + [b"HELLO\n", b"\xff\xff\n", b"x" * 300 + b"\n", b"LED:SEL 9\n", b"LED:OFF\n", b"\n"]
    + [b"SEQ:ARM 1000,50000,0,1,2,3,-1\n", b"SEQ:STAT?\n", b"LED:OFF\n", b"SEQ:STEP? 0\n"]
)


def main():
    while True:
        request = sys.stdin.readline()
        if not request:
            return
        print(answer(request).hex())


if __name__ == "__main__":
    main()
