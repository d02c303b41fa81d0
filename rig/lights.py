"""The driver of the LED controller."""

from __future__ import annotations

import secrets
import time
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from firmware_sim import Clock, RealClock

from .errors import LightControllerError
from .serial_line import SerialLine
from .wire import BANNER, MAX_SEQUENCE, Garbled, Reply, decode_reply, encode_command

__all__ = ["ControllerIdentity", "LightController", "LightState", "Switch"]

PROTOCOL_VERSION = 2
VENDOR = "PS4RIG"
_OPEN_TIMEOUT_S = 3.0
_REPLY_TIMEOUT_S = 0.5


@dataclass(frozen=True)
class ControllerIdentity:
    """What the controller says of itself."""

    vendor: str
    model: str
    serial_number: str
    firmware_version: str
    protocol_version: int


@dataclass(frozen=True)
class Switch:
    """An acknowledged change of the lights.

    `led` is None for all off. `controller_time_us` is when the LED changed, on the controller's
    own clock; `acknowledged_s` is when we knew, on the rig's clock: light is new from then on.
    """

    led: int | None
    controller_time_us: int
    acknowledged_s: float


@dataclass(frozen=True)
class LightState:
    """The controller's own account of its LEDs."""

    led: int | None
    levels_percent: tuple[int, ...]
    controller_time_us: int


class LightController:
    """An open LED controller: exclusive, with a deadline on every exchange.

    All LEDs are out when it is opened and when it is closed. A failed exchange raises
    `LightControllerError`; nothing is repeated silently, so a `Switch` that was returned happened.

    Parameters
    ----------
    port
        Device name or pyserial URL.
    clock
        The rig's clock, on which acknowledges are stamped.
    """

    def __init__(
        self, port: str, *, clock: Clock | None = None, baud: int = 115_200, watchdog_ms: int = 5000
    ) -> None:
        self._clock = clock if clock is not None else RealClock()
        # Not from 1: late replies to the program before must not look like replies to this one.
        self._sequence = secrets.randbelow(MAX_SEQUENCE) + 1
        self._line = SerialLine(port, baud, _REPLY_TIMEOUT_S)
        try:
            self.identity = self._identify()
            self._exchange("*RST")
            self._exchange(f"SYST:WDOG {watchdog_ms}")
            self.led_count = len(self.state().levels_percent)
        except BaseException:
            self._line.close()
            raise

    @property
    def port(self) -> str:
        """The port it was opened on."""
        return self._line.port

    def select(self, led: int) -> Switch:
        """Light LED `led` (0-based) and no other."""
        shown, time_us = self._numbers(self._exchange(f"LED:SEL {led}"), 2)
        if shown != led:
            raise LightControllerError(f"{self.port}: asked for LED {led}, it lit LED {shown}")
        return Switch(led, time_us, self._clock.now_s())

    def off(self) -> Switch:
        """Put all LEDs out."""
        shown, time_us = self._numbers(self._exchange("LED:OFF"), 2)
        if shown != -1:
            raise LightControllerError(f"{self.port}: asked for all off, LED {shown} is lit")
        return Switch(None, time_us, self._clock.now_s())

    def set_level(self, led: int, percent: int) -> None:
        """Brightness of one LED when it is lit, 0 to 100 %."""
        if self._numbers(self._exchange(f"LED:LEV {led},{percent}"), 2) != (led, percent):
            raise LightControllerError(f"{self.port}: level {percent} % of LED {led} did not hold")

    def state(self) -> LightState:
        """Ask the controller what is lit; this also keeps its watchdog quiet."""
        reply = self._exchange("LED:STAT?")
        led, *levels, time_us = self._numbers(reply, max(3, reply.text.count(",") + 1))
        return LightState(None if led == -1 else led, tuple(levels), time_us)

    def confirm(self, led: int | None) -> LightState:
        """Make sure that `led` (None: no LED) is still what is lit, and return the whole state.

        Raises
        ------
        LightControllerError
            If not: the watchdog tripped, or somebody else switched.
        """
        state = self.state()
        if state.led != led:
            raise LightControllerError(
                f"{self.port}: {_named(led)} should be lit but {_named(state.led)} is; "
                "the controller's watchdog may have tripped"
            )
        return state

    def close(self) -> None:
        """Put the LEDs out if the controller still listens, and release the port."""
        # Whatever goes wrong here, the watchdog puts the LEDs out.
        try:
            with suppress(LightControllerError):
                try:
                    self.off()
                except LightControllerError:
                    # An interrupted write may have left half a line, and spoilt this one: end
                    # it, take its reply, and say it again.
                    self._line.write(b"\n")
                    self._line.read_line(time.monotonic() + _REPLY_TIMEOUT_S)
                    self.off()
        finally:
            self._line.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _identify(self) -> ControllerIdentity:
        """Wait out a reset that opening the port may have caused, then ask who is there."""
        deadline_s = time.monotonic() + _OPEN_TIMEOUT_S
        # Ends whatever half line a previous program left in the controller.
        self._line.write(b"\n")
        heard = b""
        while (now_s := time.monotonic()) < deadline_s:
            sequence = self._send("*IDN?")
            try_until_s = min(deadline_s, now_s + _REPLY_TIMEOUT_S)
            while (line := self._line.read_line(try_until_s)) is not None:
                heard = line
                if line.startswith(BANNER):
                    break  # it has just started: what was sent before is lost, ask again
                with suppress(Garbled):
                    reply = decode_reply(line)
                    if reply.sequence == sequence and reply.ok:
                        return self._checked_identity(reply.text)
        if heard:
            said = heard[:40].decode("ascii", "replace")
            raise LightControllerError(
                f"{self.port}: no intact answer to *IDN? in {_OPEN_TIMEOUT_S:g} s; this is not a "
                f"light controller, or the line is bad (it said {said!r})"
            )
        raise LightControllerError(
            f"{self.port}: no answer in {_OPEN_TIMEOUT_S:g} s; is this the light controller, and "
            "does it have power?"
        )

    def _checked_identity(self, text: str) -> ControllerIdentity:
        fields = text.split(",")
        if len(fields) < 5 or fields[0] != VENDOR or not fields[4].isdigit():
            raise LightControllerError(
                f"{self.port}: what is there is not a {VENDOR} light controller (it is {text!r})"
            )
        vendor, model, serial_number, firmware_version, protocol = fields[:5]
        identity = ControllerIdentity(vendor, model, serial_number, firmware_version, int(protocol))
        if identity.protocol_version != PROTOCOL_VERSION:
            older = identity.protocol_version < PROTOCOL_VERSION
            raise LightControllerError(
                f"{self.port}: the controller speaks protocol version "
                f"{identity.protocol_version}, this program version {PROTOCOL_VERSION}; "
                + ("renew its firmware: ps4rig rig flash" if older else "update this program")
            )
        return identity

    def _send(self, command: str) -> int:
        self._sequence = self._sequence % MAX_SEQUENCE + 1
        self._line.write(encode_command(self._sequence, command))
        return self._sequence

    def _exchange(self, command: str) -> Reply:
        sequence = self._send(command)
        deadline_s = time.monotonic() + _REPLY_TIMEOUT_S
        while (line := self._line.read_line(deadline_s)) is not None:
            if line.startswith(BANNER):
                raise LightControllerError(
                    f"{self.port}: the controller restarted before it answered {command!r}"
                )
            try:
                reply = decode_reply(line)
            except Garbled as error:
                raise LightControllerError(
                    f"{self.port}: garbled reply to {command!r}: {line[:40]!r}"
                ) from error
            if reply.sequence is not None and reply.sequence != sequence:
                continue  # the late answer to an exchange that was given up
            if not reply.ok:
                raise LightControllerError(f"{self.port}: {command!r} was refused: {reply.text}")
            if reply.sequence == sequence:
                return reply
        raise LightControllerError(
            f"{self.port}: no answer to {command!r} in {_REPLY_TIMEOUT_S:g} s; "
            "the controller hangs or has lost power"
        )

    def _numbers(self, reply: Reply, count: int) -> tuple[int, ...]:
        try:
            numbers = tuple(int(field) for field in reply.text.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != count:
            raise LightControllerError(f"{self.port}: unexpected reply {reply.text!r}")
        return numbers


def _named(led: int | None) -> str:
    return "no LED" if led is None else f"LED {led}"
