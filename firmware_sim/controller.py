"""The whole simulated device: the firmware on its board, how it boots, how long its line takes."""

import random
import threading

from .board import SimulatedBoard
from .clock import Clock
from .firmware import Firmware

__all__ = ["SimulatedController"]


class SimulatedController:
    """An LED controller as a host meets it at the other end of a cable.

    Thread-safe: `poll` may come from a clock's tick while a server feeds bytes.

    Parameters
    ----------
    board
        The simulated board, on the same clock.
    clock
        Its time, real or virtual.
    resets_on_open
        True: a host that opens the port resets the board (Arduino style); False: it does not
        (Raspberry Pi Pico).
    boot_ms
        From a reset to the banner; bytes that arrive in this time are lost.
    link_delay_ms
        The time each line takes on the wire, spent before it is executed.
    turn_us
        The least and the most time of one turn of the firmware's main loop; some 50 to 200 us
        for MicroPython. While a sequence runs the loop is simulated turn by turn, so that it comes
        to an edge of the strobe, or to a time it waits for, up to one turn late.
    """

    def __init__(
        self,
        board: SimulatedBoard,
        clock: Clock,
        *,
        resets_on_open: bool = False,
        boot_ms: float = 300.0,
        link_delay_ms: float = 1.0,
        turn_us: tuple[float, float] = (50.0, 200.0),
    ) -> None:
        self.clock = clock
        self._board = board
        self._resets_on_open = resets_on_open
        self._boot_us = round(boot_ms * 1000.0)
        self._link_delay_s = link_delay_ms / 1000.0
        self._turn_us = turn_us
        self._turns = random.Random(0)
        self._in_loop = False  # the next turn is on the clock's agenda
        self._lock = threading.Lock()
        self._firmware: Firmware | None = Firmware(board)  # None while it boots

    def connect(self) -> None:
        """A host has opened the port. What was sent when nobody listened is lost."""
        with self._lock:
            self._board.take_output()
        if self._resets_on_open:
            self.reset()

    def reset(self) -> None:
        """Power cycle: LEDs out at once, the banner after the boot time."""
        with self._lock:
            self._firmware = None
            self._board.reset()

    def feed(self, data: bytes) -> None:
        """Bytes from the host; returns when every line in them has been executed."""
        *lines, rest = data.split(b"\n")
        for line in lines:
            self.clock.sleep_s(self._link_delay_s)  # no lock held: others poll in this time
            self._arrive(line + b"\n")
        self._arrive(rest)

    def poll(self) -> None:
        """One turn of the device's main loop, unless its turns are timed. Never waits."""
        with self._lock:
            if not self._in_loop:
                self._turn()

    def strobe(self, exposing: bool, at_s: float) -> None:
        """An edge on the wire of the camera's strobe. It keeps its true time if it comes late."""
        self._board.strobe(exposing, at_s)

    def take_output(self) -> bytes:
        """What the device has sent since the last call."""
        return self._board.take_output()

    @property
    def boot_remaining_s(self) -> float:
        """Time until the device is ready; 0 when it is."""
        with self._lock:
            if self._firmware is not None:
                return 0.0
            return max(0, self._boot_us - self._board.micros()) / 1e6

    def _arrive(self, data: bytes) -> None:
        with self._lock:
            if self._turn():
                self._board.receive(data)
                self._turn()

    def _turn(self) -> bool:
        """Boot or run the firmware, lock held; return whether it is running."""
        if self._firmware is None:
            if self._board.micros() < self._boot_us:
                return False
            self._firmware = Firmware(self._board)
        if self._firmware.stopped:
            return False  # a board would be at its own prompt; this one waits for its reset
        self._firmware.poll()
        if self._firmware.sequence.running and not self._in_loop:
            self._in_loop = True
            turn_s = self._turns.uniform(*self._turn_us) / 1e6
            self.clock.call_at(self.clock.now_s() + turn_s, self._timed_turn)
        return True

    def _timed_turn(self) -> None:
        with self._lock:
            self._in_loop = False
            self._turn()
