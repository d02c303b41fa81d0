"""The simulated device as a whole: firmware, board, boot time and delay of the line."""

import random
import threading

from .board import SimulatedBoard
from .clock import Clock
from .firmware import Firmware


class SimulatedController:
    """A thread-safe LED controller at the end of a cable.

    Its main loop handles an edge up to one pass late; a pass takes `pass_us` (MicroPython: 50 to
    200 us).
    """

    def __init__(
        self,
        board: SimulatedBoard,
        clock: Clock,
        *,
        resets_on_open: bool = False,
        boot_ms: float = 300.0,
        link_delay_ms: float = 1.0,
        pass_us: tuple[float, float] = (50.0, 200.0),
    ) -> None:
        self.clock = clock
        self._board = board
        self._resets_on_open = resets_on_open
        self._boot_us = round(boot_ms * 1000.0)
        self._link_delay_s = link_delay_ms / 1000.0
        self._pass_us = pass_us
        self._pass_rng = random.Random(0)
        self._pass_is_scheduled = False
        self._lock = threading.Lock()
        self._firmware: Firmware | None = Firmware(board)  # None while it boots

    def connect(self) -> None:
        """Handle a host that opens the port: drop earlier output, reset if configured so."""
        with self._lock:
            self._board.take_output()
        if self._resets_on_open:
            self.reset()

    def reset(self) -> None:
        """Simulate a power cycle: LEDs off at once, the banner after the boot time."""
        with self._lock:
            self._firmware = None
            self._board.reset()

    def feed(self, data: bytes) -> None:
        """Receive bytes from the host; return when every line in them has been executed."""
        *lines, unfinished = data.split(b"\n")
        for line in lines:
            self.clock.sleep_s(self._link_delay_s)  # without the lock, so that others can poll
            self._receive(line + b"\n")
        self._receive(unfinished)

    def poll(self) -> None:
        """Run one pass of the main loop without waiting, unless the clock times the passes."""
        with self._lock:
            if not self._pass_is_scheduled:
                self._run_pass()

    def take_output(self) -> bytes:
        """Return the bytes that the device has sent since the last call."""
        return self._board.take_output()

    @property
    def boot_remaining_s(self) -> float:
        """Time until the device is ready; 0 when it is."""
        with self._lock:
            if self._firmware is not None:
                return 0.0
            return max(0, self._boot_us - self._board.micros()) / 1e6

    def _receive(self, data: bytes) -> None:
        with self._lock:
            if self._run_pass():
                self._board.receive(data)
                self._run_pass()

    def _run_pass(self) -> bool:
        """Boot or run the firmware with the lock held; return whether it is running."""
        if self._firmware is None:
            if self._board.micros() < self._boot_us:
                return False
            self._firmware = Firmware(self._board)
        if self._firmware.stopped:
            return False  # a real board would be at MicroPython's prompt
        self._firmware.poll()
        if self._firmware.sequence.running and not self._pass_is_scheduled:
            self._pass_is_scheduled = True
            pass_s = self._pass_rng.uniform(*self._pass_us) / 1e6
            self.clock.call_at(self.clock.now_s() + pass_s, self._run_timed_pass)
        return True

    def _run_timed_pass(self) -> None:
        with self._lock:
            self._pass_is_scheduled = False
            self._run_pass()
