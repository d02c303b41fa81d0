"""Simulated faults of the serial line and of LEDs, below the driver."""

import itertools
import math
import random
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from .board import Led, LedLight, SimulatedBoard
from .clock import Clock
from .controller import SimulatedController

# Number of pieces of a flicker period over which the light counts as steady. The integral over a
# whole period is exact to rounding, because evenly spaced samples of a sine sum to zero.
_PIECES_PER_PERIOD = 16


class _FaultModel(BaseModel):
    """A frozen table of a fault plan; unknown keys, and truth values as numbers, are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


def _require_duration(from_s: float, until_s: float) -> None:
    if not from_s < until_s:
        raise ValueError(f"from_s is {from_s:g}; give a time before until_s, {until_s:g}")


class When(_FaultModel):
    """Conditions for the events that a fault affects; all that are given must hold."""

    nth: int | None = Field(
        default=None, ge=1, description="only this event, counted from 1 at from_s"
    )
    times: int = Field(default=1, ge=1, description="with nth: number of successive events")
    from_s: float = Field(default=0.0, description="on the simulation's clock, which starts at 0")
    until_s: float = Field(default=math.inf, description="no end by default")
    probability: float = Field(default=1.0, gt=0.0, le=1.0, description="of each of these events")

    @model_validator(mode="after")
    def _has_a_duration(self) -> Self:
        _require_duration(self.from_s, self.until_s)
        return self

    def covers(self, at_s: float) -> bool:
        """Whether `at_s` is between `from_s` and `until_s`."""
        return self.from_s <= at_s < self.until_s

    def affects(self, number: int, rng: random.Random) -> bool:
        """Whether the fault affects event `number`, counted from 1 at `from_s`."""
        if self.nth is not None and not self.nth <= number < self.nth + self.times:
            return False
        return self.probability == 1.0 or rng.random() < self.probability


class LineFault(_FaultModel):
    """A fault of lines on the serial line."""

    kind: Literal[
        "lose", "garble", "truncate", "double", "lose_byte", "double_byte", "delay", "late",
        "reboot",
    ] = Field(
        description="garble: one to three wrong bytes; truncate: the end is missing; late: comes "
        "with the next line; reboot: the controller restarts instead"
    )  # fmt: skip
    direction: Literal["to_controller", "to_host"] = Field(
        default="to_controller", description="commands, or the replies to them"
    )
    containing: str = Field(
        default="", description="only commands with this text, and their replies"
    )
    delay_ms: float = Field(default=50.0, ge=0.0, le=60_000.0, description="of kind delay")
    when: When = Field(default=When(), description="the events that are affected, by default all")

    @model_validator(mode="after")
    def _reboots_at_a_command(self) -> Self:
        if self.kind == "reboot" and self.direction != "to_controller":
            raise ValueError("a reboot happens at a line to the controller")
        return self


class LedFault(_FaultModel):
    """A fault in the light of one LED, during a time."""

    kind: Literal["dead", "dim", "stuck_on", "flicker", "unsteady", "swapped"] = Field(
        description="flicker: a sine; unsteady: at random; swapped: its cable is exchanged with "
        "that of other"
    )
    led: int = Field(ge=0, description="counted from 0")
    share: float = Field(
        default=0.5,
        ge=0.0,
        le=1.0,
        description="of the light that is missing; stuck_on: that stays",
    )
    frequency_hz: float = Field(
        default=50.0, ge=0.001, le=1e5, description="of flicker and unsteady"
    )
    other: int | None = Field(default=None, ge=0, description="of swapped")
    from_s: float = Field(default=0.0, description="on the simulation's clock, which starts at 0")
    until_s: float = Field(default=math.inf, description="no end by default")

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        _require_duration(self.from_s, self.until_s)
        if (self.kind == "swapped") != (self.other is not None):
            raise ValueError(
                f"kind is {self.kind!r} and other is {self.other}; other is the LED that this one "
                "is swapped with, and belongs to kind 'swapped'"
            )
        return self

    def gain(self, at_s: float, rng_key: str) -> float:
        """The share of the LED's light that remains at a time."""
        if not self.from_s <= at_s < self.until_s or self.kind in ("stuck_on", "swapped"):
            return 1.0
        if self.kind == "dead":
            return 0.0
        depth = 1.0  # of the fault: "dim" is constant
        if self.kind == "flicker":
            depth = 0.5 + 0.5 * math.sin(2.0 * math.pi * self.frequency_hz * at_s)
        elif self.kind == "unsteady":
            slot = math.floor(at_s * self.frequency_hz)
            depth = random.Random(f"{rng_key} {slot}").random()
        return 1.0 - self.share * depth

    def floor(self, at_s: float) -> float:
        """The light that the LED gives at a time even while it is switched off."""
        stuck = self.kind == "stuck_on" and self.from_s <= at_s < self.until_s
        return self.share if stuck else 0.0


class _FaultyLed:
    """An LED with faults in its light."""

    def __init__(self, led: Led, faults: Sequence[LedFault], seed: int, started_s: float) -> None:
        self._led = led
        self._faults = faults
        self._seed = seed
        self._started_s = started_s

    def drive(self, percent: int, at_s: float) -> None:
        self._led.drive(percent, at_s)

    def output(self, at_s: float) -> float:
        gain, floor = self._gain_and_floor(at_s)
        return max(floor, gain * self._led.output(at_s))

    def output_integral_s(self, start_s: float, end_s: float) -> float:
        """The integral of the output, in pieces over which the faults count as constant."""
        total_s = 0.0
        for begin_s, finish_s in self._pieces(start_s, end_s):
            gain, floor = self._gain_and_floor(0.5 * (begin_s + finish_s))
            lit_s = gain * self._led.output_integral_s(begin_s, finish_s)
            total_s += max(floor * (finish_s - begin_s), lit_s)
        return total_s

    def _gain_and_floor(self, at_s: float) -> tuple[float, float]:
        since_s = at_s - self._started_s
        keys = (f"{self._seed} {number}" for number in range(len(self._faults)))
        gains = [f.gain(since_s, key) for f, key in zip(self._faults, keys, strict=True)]
        return math.prod(gains), max(fault.floor(since_s) for fault in self._faults)

    def _pieces(self, start_s: float, end_s: float) -> Iterator[tuple[float, float]]:
        cuts = {start_s, end_s}
        for fault in self._faults:
            cuts |= {edge + self._started_s for edge in (fault.from_s, fault.until_s)}
            if fault.kind in ("flicker", "unsteady"):
                count = max(1, math.ceil((end_s - start_s) * fault.frequency_hz))
                count *= _PIECES_PER_PERIOD
                cuts |= {start_s + (end_s - start_s) * i / count for i in range(1, count)}
        inside = sorted(cut for cut in cuts if start_s <= cut <= end_s)
        return itertools.pairwise(inside)


class _SwappedLed:
    """An LED whose cable may be exchanged: its pin drives `driven`, its light comes from `own`."""

    def __init__(self, own: LedLight, driven: LedLight) -> None:
        self.drive = driven.drive
        self.output = own.output
        self.output_integral_s = own.output_integral_s


def faulty_leds(
    leds: Sequence[Led], faults: Iterable[LedFault], seed: int, started_s: float
) -> list[LedLight]:
    """Make the LEDs of a board with faults, in the order of their pins."""
    faults = tuple(faults)
    lights: list[LedLight] = []
    for index, led in enumerate(leds):
        own_faults = [fault for fault in faults if fault.led == index and fault.kind != "swapped"]
        lights.append(_FaultyLed(led, own_faults, seed + index, started_s) if own_faults else led)
    driven = [*lights]  # by pin
    for fault in faults:
        if fault.other is not None:
            driven[fault.led], driven[fault.other] = driven[fault.other], driven[fault.led]
    return [_SwappedLed(own, by_pin) for own, by_pin in zip(lights, driven, strict=True)]


class FaultyLine(SimulatedController):
    """A `SimulatedController` behind a line whose faults apply one after the other."""

    def __init__(
        self,
        board: SimulatedBoard,
        clock: Clock,
        faults: Sequence[LineFault],
        seed: int,
        pass_us: tuple[float, float] = (50.0, 200.0),
    ) -> None:
        super().__init__(board, clock, pass_us=pass_us)
        self._faults = faults
        self._rng = random.Random(seed)
        self._started_s = clock.now_s()
        self._counts = [0] * len(faults)
        self._half_line = b""
        self._command = b""
        self._delayed: dict[str, bytes] = {"to_controller": b"", "to_host": b""}
        self._output = b""

    def connect(self) -> None:
        self._half_line = self._output = b""
        super().connect()

    def feed(self, data: bytes) -> None:
        *lines, self._half_line = (self._half_line + data).split(b"\n")
        for line in lines:
            self._collect_output()
            self._command = line
            super().feed(self._transmitted("to_controller", line + b"\n"))
            self._collect_output()

    def take_output(self) -> bytes:
        self._collect_output()
        output, self._output = self._output, b""
        return output

    def _collect_output(self) -> None:
        for line in super().take_output().splitlines(keepends=True):
            self._output += self._transmitted("to_host", line)

    def _transmitted(self, direction: str, line: bytes) -> bytes:
        """Return a line as it arrives at the other end, after lines that come late."""
        since_s = self.clock.now_s() - self._started_s
        is_late = False
        for index, fault in enumerate(self._faults):
            affected = fault.direction == direction and fault.containing.encode() in self._command
            if not (affected and fault.when.covers(since_s)):
                continue
            self._counts[index] += 1
            if not fault.when.affects(self._counts[index], self._rng):
                continue
            if fault.kind == "reboot":
                self.reset()
            elif fault.kind == "delay":
                self.clock.sleep_s(fault.delay_ms / 1000.0)
            elif fault.kind == "late":
                is_late = True
            else:
                line = _damaged(line, fault.kind, self._rng)
        delayed, self._delayed[direction] = self._delayed[direction], b""
        if is_late:
            self._delayed[direction] = delayed + line
            return b""
        return delayed + line


def _damaged(line: bytes, kind: str, rng: random.Random) -> bytes:
    match kind:
        case "double":
            return line + line
        case "garble":
            damaged = bytearray(line)
            for _ in range(rng.randint(1, 3)):
                # The line end stays; `truncate` joins lines.
                damaged[rng.randrange(max(1, len(line) - 1))] ^= rng.randint(1, 255)
            return bytes(damaged)
        case "truncate":
            return line[: rng.randrange(len(line))]
        case "lose_byte":
            position = rng.randrange(len(line))
            return line[:position] + line[position + 1 :]
        case "double_byte":
            position = rng.randrange(len(line))
            return line[: position + 1] + line[position:]
    return b""  # "lose"
