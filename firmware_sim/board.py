"""The board below the firmware: its interface, and a simulated one with LEDs that rise and fall."""

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from .clock import Clock
from .firmware import STROBE_BUFFER_EDGES

# Number of switches in the history, which must reach back to the oldest unread frame. A set
# switches an LED twice: the history covers 4,000 sets, and takes 1.3 MB for each LED.
_HISTORY_EVENTS = 8192
_TAU_PER_10_90 = 1.0 / math.log(9.0)  # an exponential goes from 10 % to 90 % in tau * ln 9


@dataclass(frozen=True, slots=True)
class _Segment:
    """The exponential approach from one switch event to the next."""

    since_s: float
    start: float
    target: float
    tau_s: float

    def output(self, at_s: float) -> float:
        return self.target + self._excess(at_s)

    def integral_s(self, begin_s: float, end_s: float) -> float:
        steady_s = self.target * (end_s - begin_s)
        if self.tau_s == 0.0:
            return steady_s
        decay = -math.expm1((begin_s - end_s) / self.tau_s)
        return steady_s + self._excess(begin_s) * self.tau_s * decay

    def _excess(self, at_s: float) -> float:
        """Difference of the output from its target."""
        if self.tau_s == 0.0:
            return 0.0
        return (self.start - self.target) * math.exp((self.since_s - at_s) / self.tau_s)


class LedLight(Protocol):
    """The interface of an LED on a board."""

    def drive(self, percent: int, at_s: float) -> None:
        """Set the drive; `at_s` must not be earlier than that of the last call."""

    def output(self, at_s: float) -> float:
        """Return the relative output at a time."""

    def output_integral_s(self, start_s: float, end_s: float) -> float:
        """Return the integral of the output over an interval, in seconds of full output."""


class Led:
    """Relative optical output (0 to 1) of one LED over time, from its switch history."""

    def __init__(self, rise_ms: float, fall_ms: float) -> None:
        self._rise_tau_s = rise_ms / 1000.0 * _TAU_PER_10_90
        self._fall_tau_s = fall_ms / 1000.0 * _TAU_PER_10_90
        self._history = deque([_Segment(-math.inf, 0.0, 0.0, 0.0)], maxlen=_HISTORY_EVENTS)

    def drive(self, percent: int, at_s: float) -> None:
        """Set the level, 0 to 100, from a time on; times must not decrease."""
        current = self._history[-1]
        target = percent / 100.0
        if target == current.target:
            return  # the current approach continues
        start = current.output(at_s)
        tau_s = self._rise_tau_s if target > start else self._fall_tau_s
        self._history.append(_Segment(at_s, start, target, tau_s))

    def output(self, at_s: float) -> float:
        """Return the relative output at a time; ValueError before the history begins."""
        for segment in reversed(self._history):
            if segment.since_s <= at_s:
                return segment.output(at_s)
        raise self._too_early(at_s)

    def output_integral_s(self, start_s: float, end_s: float) -> float:
        """Return the integral of the output in seconds of full output; errors as `output`."""
        total_s = 0.0
        for segment in reversed(self._history):
            if segment.since_s < end_s:
                begin_s = max(start_s, segment.since_s)
                total_s += segment.integral_s(begin_s, end_s)
                end_s = begin_s
            if segment.since_s <= start_s:
                return total_s
        raise self._too_early(start_s)

    def _too_early(self, at_s: float) -> ValueError:
        first_s = self._history[0].since_s
        return ValueError(f"the LED's history starts at {first_s:.6f} s, after {at_s:.6f} s")


_MAX_DUTY_PERCENT = 50  # as on the Pico
_OUTPUT_BYTES = 4096  # buffer for a host that does not read; about 100 replies
_CLOCK_ROUNDING_S = 1e-6  # the clock has nanoseconds, the firmware microseconds


class Board(Protocol):
    """Pins, clock and serial line of the controller, as the firmware sees them."""

    @property
    def led_count(self) -> int:
        """The number of LEDs, at least 1."""

    @property
    def serial_number(self) -> str:
        """Printable ASCII without blanks and commas; part of the identity."""

    def micros(self) -> int:
        """Microseconds since boot; a board whose counter wraps extends it."""

    def read(self) -> bytes:
        """Return the bytes received since the last call, b"" without any; never wait."""

    def write(self, data: bytes) -> None:
        """Send to the host; never wait."""

    def set_led(self, index: int, percent: int) -> int:
        """Drive one LED at 0 to 100 percent; return the `micros` at which it changed."""

    def max_on_ms(self, index: int) -> int:
        """Longest time in milliseconds that an LED may be on without a pause, at least 1."""

    def max_duty_percent(self, index: int) -> int:
        """Largest share of the time that an LED may be on in the long run, 1 to 99 percent."""

    def strobe_edges(self) -> list[tuple[int, bool]]:
        """Edges of the strobe since the last call: `micros`, and whether an exposure begins.

        There are `firmware.STROBE_BUFFER_EDGES` at most.
        """

    def part_edges(self) -> list[int]:
        """The `micros` of parts since the last call, oldest first, without bounces of a contact."""

    def trigger(self) -> int:
        """Begin a pulse on the trigger line, and return its `micros`; may wait for 100 us."""


class SimulatedBoard:
    """A thread-safe board with LEDs that rise and fall.

    The firmware enforces the limits of the LEDs, which by default permit 1024 frames at 9 per
    second.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        led_count: int = 4,
        serial_number: str = "SIM-0001",
        rise_ms: float = 0.5,
        fall_ms: float = 0.3,
        max_on_ms: int = 120_000,
        leds: Sequence[LedLight] | None = None,
    ) -> None:
        if led_count < 1:
            raise ValueError(f"led_count is {led_count}; a board has at least 1 LED")
        if not serial_number or not all("!" <= c <= "~" and c not in ',~"' for c in serial_number):
            raise ValueError(
                f"serial number {serial_number!r}: use printable ASCII without blank , ~ or quote"
            )
        for name, time_ms in (("rise_ms", rise_ms), ("fall_ms", fall_ms)):
            if not (math.isfinite(time_ms) and time_ms >= 0):
                raise ValueError(f"{name} is {time_ms}; give a time in milliseconds, 0 or more")
        if max_on_ms < 1:
            raise ValueError(f"max_on_ms is {max_on_ms}; give 1 or more")
        self.led_count = led_count
        self.serial_number = serial_number
        self._clock = clock
        self._lock = threading.Lock()
        self._leds = leds or [Led(rise_ms, fall_ms) for _ in range(led_count)]
        self._booted_s = clock.now_s()
        self._max_on_ms = [max_on_ms] * led_count
        self._max_duty_percent = [_MAX_DUTY_PERCENT] * led_count
        self._received = b""
        self._sent = b""
        self._strobe_edges: list[tuple[int, bool]] = []
        self._part_edges: list[int] = []
        self._trigger_camera: Callable[[], object] = lambda: None

    # Interface to the firmware

    def micros(self) -> int:
        return self._micros_at(self._clock.now_s())

    def read(self) -> bytes:
        if not self._received:
            return b""
        with self._lock:
            data, self._received = self._received, b""
            return data

    def write(self, data: bytes) -> None:
        with self._lock:
            # If a host never reads, whole lines are dropped and memory stays bounded.
            if len(self._sent) + len(data) <= _OUTPUT_BYTES:
                self._sent += data

    def set_led(self, index: int, percent: int) -> int:
        with self._lock:
            now_s = self._clock.now_s()
            self._leds[index].drive(percent, now_s)
            return self._micros_at(now_s)

    def max_on_ms(self, index: int) -> int:
        return self._max_on_ms[index]

    def max_duty_percent(self, index: int) -> int:
        return self._max_duty_percent[index]

    def strobe_edges(self) -> list[tuple[int, bool]]:
        if not self._strobe_edges:
            return []
        with self._lock:
            edges, self._strobe_edges = self._strobe_edges, []
            return edges

    def part_edges(self) -> list[int]:
        if not self._part_edges:
            return []
        with self._lock:
            edges, self._part_edges = self._part_edges, []
            return edges

    def trigger(self) -> int:
        triggered_us = self.micros()
        self._trigger_camera()
        return triggered_us

    # Interface to host and camera

    def receive(self, data: bytes) -> None:
        """Receive bytes from the host."""
        with self._lock:
            self._received += data

    def take_output(self) -> bytes:
        """Return the bytes that the firmware has sent since the last call."""
        with self._lock:
            data, self._sent = self._sent, b""
            return data

    def strobe(self, exposing: bool, at_s: float) -> None:
        """Add an edge of the strobe line, with its true time; it waits for the firmware."""
        with self._lock:
            if len(self._strobe_edges) < STROBE_BUFFER_EDGES:
                self._strobe_edges.append((self._micros_at(at_s), exposing))

    def see_part(self, at_s: float) -> None:
        """Add an edge of the part sensor, with its true time; it waits for the firmware."""
        with self._lock:
            if len(self._part_edges) < STROBE_BUFFER_EDGES:
                self._part_edges.append(self._micros_at(at_s))

    def on_trigger(self, callback: Callable[[], object]) -> None:
        """Connect a camera: call `callback` at the beginning of each trigger pulse."""
        self._trigger_camera = callback

    def reset(self) -> None:
        """Power cycle: LEDs off, waiting bytes and edges lost, `micros` starts again at 0."""
        with self._lock:
            self._booted_s = self._clock.now_s()
            for led in self._leds:
                led.drive(0, self._booted_s)
            self._received = self._sent = b""
            self._strobe_edges = []
            self._part_edges = []

    def output(self, led: int, at_s: float) -> float:
        """Relative optical output of an LED, 0 to 1, at a time not in the future."""
        with self._lock:
            self._refuse_future(at_s)
            return self._leds[led].output(at_s)

    def output_integral_s(self, led: int, start_s: float, end_s: float) -> float:
        """Exact integral of an LED's output over an interval, in seconds of full output."""
        with self._lock:
            if end_s < start_s:
                raise ValueError(f"the interval ends at {end_s} s, before its start {start_s} s")
            self._refuse_future(end_s)
            return self._leds[led].output_integral_s(start_s, end_s)

    def _micros_at(self, now_s: float) -> int:
        # Rounded, because truncation could lose a microsecond of a virtual clock.
        return round((now_s - self._booted_s) * 1e6)

    def _refuse_future(self, at_s: float) -> None:
        now_s = self._clock.now_s()
        if at_s > now_s + _CLOCK_ROUNDING_S:
            raise ValueError(f"the light at {at_s:.6f} s is not known yet: it is {now_s:.6f} s")
