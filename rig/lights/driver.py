"""The driver of the LED controller."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from firmware_sim import Clock, RealClock
from firmware_sim.firmware import WATCHDOG_MIN_MS
from rig.errors import LightControllerError

from .heartbeat import Heartbeat
from .link import REPLY_TIMEOUT_S, ControllerIdentity, ControllerLink
from .wire import Reply

__all__ = ["Answer", "ControllerIdentity", "LightController", "LightState", "Switch"]

# What is plugged in again takes a second or two until its port is there.
_RECOVER_TIMEOUT_S = 5.0
_RECOVER_PAUSE_S = 0.1
# A program that has not used the lights for so long has forgotten them, or hangs.
ATTENDED_S = 600.0


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


@dataclass(frozen=True)
class Answer:
    """The numbers of a reply, and when the question was sent and the reply was here."""

    numbers: tuple[int, ...]
    sent_s: float
    received_s: float


class LightController:
    """An open LED controller: exclusive, with a deadline on every exchange.

    All LEDs are out when it is opened and when it is closed. A failed exchange raises
    `LightControllerError`; nothing is repeated silently, so a `Switch` that was returned happened.
    After a failure the LEDs are left to the controller's watchdog until `recover` is called.
    Thread-safe: one exchange at a time.

    Parameters
    ----------
    port
        Device name or pyserial URL.
    clock
        The rig's clock, on which acknowledges are stamped.
    whereabouts
        Ports on which `recover` looks for the controller, in this order; `port` if left out.
    """

    def __init__(
        self,
        port: str,
        *,
        clock: Clock | None = None,
        baud: int = 115_200,
        watchdog_ms: int = 5000,
        whereabouts: Callable[[], Iterable[str]] | None = None,
    ) -> None:
        self._clock = clock if clock is not None else RealClock()
        self._baud = baud
        self._watchdog_ms = watchdog_ms
        self._whereabouts = whereabouts if whereabouts is not None else lambda: (port,)
        self._lock = threading.RLock()
        self._heartbeat: Heartbeat | None = None
        self._missed_beat: LightControllerError | None = None
        self._levels_percent: dict[int, int] = {}
        self._has_failed = False
        self._attend()
        self._link = ControllerLink(port, baud)
        try:
            self._prepare()
            self.led_count = len(self.state().levels_percent)
        except BaseException:
            self._link.close()
            raise

    @property
    def identity(self) -> ControllerIdentity:
        """What the controller says of itself."""
        return self._link.identity

    @property
    def port(self) -> str:
        """The port it was opened on."""
        return self._link.port

    def select(self, led: int) -> Switch:
        """Light LED `led` (0-based) and no other."""
        shown, time_us = self._numbers(self._exchange(f"LED:SEL {led}"), 2)
        if shown != led:
            raise self._failed(f"asked for LED {led}, it lit LED {shown}")
        return Switch(led, time_us, self._clock.now_s())

    def off(self) -> Switch:
        """Put all LEDs out."""
        shown, time_us = self._numbers(self._exchange("LED:OFF"), 2)
        if shown != -1:
            raise self._failed(f"asked for all off, LED {shown} is lit")
        return Switch(None, time_us, self._clock.now_s())

    def set_level(self, led: int, percent: int) -> None:
        """Brightness of one LED when it is lit, 0 to 100 %."""
        if self._numbers(self._exchange(f"LED:LEV {led},{percent}"), 2) != (led, percent):
            raise self._failed(f"level {percent} % of LED {led} did not hold")
        self._levels_percent[led] = percent

    def state(self) -> LightState:
        """Ask the controller what is lit; this also keeps its watchdog quiet."""
        return self._state_in(self._exchange("LED:STAT?"))

    def ask(self, command: str, count: int) -> Answer:
        """Send any command whose reply is `count` numbers; times are on the rig's clock."""
        sent_s = self._clock.now_s()
        numbers = self._numbers(self._exchange(command), count)
        return Answer(numbers, sent_s, self._clock.now_s())

    def confirm(self, led: int | None) -> LightState:
        """Make sure that `led` (None: no LED) is still what is lit, and return the whole state.

        Raises
        ------
        LightControllerError
            If not, with the oldest entry of the controller's error queue: its watchdog tripped,
            the LED has been on for as long as it may, or somebody else switched.
        """
        state = self.state()
        if state.led != led:
            said = self._exchange("SYST:ERR?").text
            raise self._failed(
                f"{_named(led)} should be lit but {_named(state.led)} is; "
                f"its watchdog may have tripped (it says {said})"
            )
        return state

    def trips_watchdog(self) -> bool:
        """Whether the controller puts an LED out by itself when it is left alone.

        It is told to wait for its shortest time, and again for its ordinary time afterwards.
        """
        with self._lock:  # no heartbeat meanwhile
            self._exchange(f"SYST:WDOG {WATCHDOG_MIN_MS}")
            self.select(0)
            self._clock.sleep_s(3.0 * WATCHDOG_MIN_MS / 1000.0)
            tripped = self.state().led is None
            self._exchange("SYST:ERR?")  # takes note of it, so that nobody wonders later
            self.off()
            self._exchange(f"SYST:WDOG {self._watchdog_ms}")
        return tripped

    def keep_alive(self) -> None:
        """Send heartbeats from a thread from here on; for real time, see `tend`."""
        if self._heartbeat is None:
            self._heartbeat = Heartbeat(self.tend)

    def tend(self) -> float:
        """Keep the controller's watchdog quiet if half its time has passed without a command.

        That is only done while the program lives: the thread that used the lights last must not
        have ended, they were used within `ATTENDED_S`, and no exchange has failed. A heartbeat
        that fails is raised by the next exchange.

        Returns
        -------
        float
            Seconds until it should be called again.
        """
        period_s = self._watchdog_ms / 2000.0
        if not self._lock.acquire(blocking=False):
            return period_s  # an exchange that is under way does the same
        try:
            due_s = self._fed_s + period_s - self._clock.now_s()
            if due_s > 0.0:
                return due_s
            if self._is_attended() and not self._has_failed:
                self._beat()
            return period_s
        finally:
            self._lock.release()

    def recover(self) -> None:
        """After a failed exchange: find the same controller again, and put its LEDs out.

        The port is opened anew, and what an old exchange left in it is thrown away. Levels that
        were set are set again. Without a failure nothing is done.

        Raises
        ------
        LightControllerError
            If it is not found in time, or another controller is in its place.
        """
        with self._lock:
            if not self._has_failed:
                return
            self._attend()
            self._link.close()
            self._reopen()
            self._has_failed = False
            self._missed_beat = None
            self._prepare()
            for led, percent in self._levels_percent.items():
                self._exchange(f"LED:LEV {led},{percent}")

    def close(self) -> None:
        """Put the LEDs out if the controller still listens, and release the port."""
        if self._heartbeat is not None:
            self._heartbeat.stop(2.0 * REPLY_TIMEOUT_S)
        self._missed_beat = None
        # Whatever goes wrong here, the watchdog puts the LEDs out.
        try:
            with suppress(LightControllerError):
                try:
                    self.off()
                except LightControllerError:
                    # An interrupted write may have left half a line, and spoilt this one.
                    self._link.end_line()
                    self.off()
        finally:
            self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _prepare(self) -> None:
        self._latest_us = 0
        self._exchange("*RST")
        self._exchange(f"SYST:WDOG {self._watchdog_ms}")

    def _reopen(self) -> None:
        deadline_s = time.monotonic() + _RECOVER_TIMEOUT_S
        wanted = self.identity.serial_number
        while True:
            failure: LightControllerError | None = None
            for port in self._whereabouts():
                try:
                    link = ControllerLink(port, self._baud, max(0.1, deadline_s - time.monotonic()))
                except LightControllerError as error:
                    failure = failure or error
                    continue
                if link.identity.serial_number == wanted:
                    self._link = link
                    return
                link.close()
                found = link.identity.serial_number
                failure = LightControllerError(
                    f"{port}: light controller {found} is there in place of "
                    f"{wanted}; plug that in again, or open the rig anew to use this one"
                )
            if time.monotonic() >= deadline_s:
                raise failure or LightControllerError(
                    f"light controller {wanted} is not plugged in any more"
                )
            time.sleep(_RECOVER_PAUSE_S)

    def _attend(self) -> None:
        """Somebody has used the lights, and so has fed the watchdog."""
        self._fed_s = self._attended_s = self._clock.now_s()
        self._attendant = threading.current_thread()

    def _is_attended(self) -> bool:
        return self._attendant.is_alive() and self._clock.now_s() - self._attended_s <= ATTENDED_S

    def _beat(self) -> None:
        self._fed_s = self._clock.now_s()
        try:
            self._state_in(self._ask("LED:STAT?"))
        except LightControllerError as error:
            self._missed_beat = error

    def _state_in(self, reply: Reply) -> LightState:
        led, *levels, time_us = self._numbers(reply, max(3, reply.text.count(",") + 1))
        if time_us < self._latest_us:
            raise self._failed("the controller has restarted: its clock went back")
        self._latest_us = time_us
        return LightState(None if led == -1 else led, tuple(levels), time_us)

    def _failed(self, cause: str) -> LightControllerError:
        self._has_failed = True
        return LightControllerError(f"{self.port}: {cause}")

    def _exchange(self, command: str) -> Reply:
        """Ask, and refuse what is refused."""
        with self._lock:
            self._attend()
            if self._missed_beat is not None:
                missed, self._missed_beat = self._missed_beat, None
                raise LightControllerError(f"while nobody switched: {missed}") from missed
            reply = self._ask(command)
        if not reply.ok:
            raise LightControllerError(f"{self.port}: {command!r} was refused: {reply.text}")
        return reply

    def _ask(self, command: str) -> Reply:
        try:
            return self._link.ask(command)
        except BaseException:
            self._has_failed = True
            raise

    def _numbers(self, reply: Reply, count: int) -> tuple[int, ...]:
        try:
            numbers = tuple(int(field) for field in reply.text.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != count:
            raise self._failed(f"unexpected reply {reply.text!r}")
        return numbers


def _named(led: int | None) -> str:
    return "no LED" if led is None else f"LED {led}"
