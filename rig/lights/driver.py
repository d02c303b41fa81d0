"""The driver of the LED controller."""

import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

from firmware_sim import Clock, RealClock
from firmware_sim.firmware import WATCHDOG_MIN_MS
from rig.errors import LightControllerError
from rig.signals import signals_held_back

from .discovery import PossiblePorts, find_again
from .keep_alive import KeepAliveThread, LightUsage
from .link import DEFAULT_TIMEOUTS, ControllerIdentity, ControllerLink, LinkTimeouts, Reply


@dataclass(frozen=True)
class Switch:
    """An acknowledged change of the lights.

    `led` is None for all off. `controller_time_us` is the time of the change on the controller's
    clock, `acknowledged_s` the later time of the acknowledgement on the rig's clock.
    """

    led: int | None
    controller_time_us: int
    acknowledged_s: float


@dataclass(frozen=True)
class _LightState:
    """The state of the LEDs as the controller reports it; `led` is None if none is lit."""

    led: int | None
    levels_percent: tuple[int, ...]


@dataclass(frozen=True)
class Answer:
    """The numbers of a reply, and the times of question and reply on the rig's clock."""

    numbers: tuple[int, ...]
    sent_s: float
    received_s: float


class LightController:
    """An open LED controller: exclusive, with a deadline on every exchange.

    All LEDs are out after opening and after closing. A failed exchange raises
    `LightControllerError` and is never repeated silently; a returned `Switch` is confirmed.
    After a failure the controller's watchdog puts the LEDs out, unless `recover` is called before.
    Thread-safe: one exchange at a time.

    Parameters
    ----------
    port
        Device name or pyserial URL.
    clock
        The rig's clock, on which acknowledgements are stamped.
    baud
        Bits per second; USB serial ports ignore it.
    watchdog_ms
        Silence after which the controller puts the LEDs out.
    possible_ports
        Ports on which `recover` looks for the controller, in this order; only `port` by default.
    timeouts
        How long to wait for the controller.

    Raises
    ------
    LightControllerError
        If the port cannot be opened, or no controller that this program can use answers there.
    """

    def __init__(
        self,
        port: str,
        *,
        clock: Clock | None = None,
        baud: int = 115_200,
        watchdog_ms: int = 5000,
        possible_ports: PossiblePorts | None = None,
        timeouts: LinkTimeouts = DEFAULT_TIMEOUTS,
    ) -> None:
        self._clock = clock if clock is not None else RealClock()
        self._baud = baud
        self._watchdog_ms = watchdog_ms
        self._possible_ports = possible_ports if possible_ports is not None else lambda: (port,)
        self._lock = threading.RLock()
        self._keep_alive_thread: KeepAliveThread | None = None
        self._missed_keep_alive: LightControllerError | None = None
        self._levels_percent: dict[int, int] = {}
        self._has_failed = False
        self._timeouts = timeouts
        self._usage = LightUsage(self._clock, watchdog_ms, timeouts.unused_s)
        self.led_count = 0
        self._link = ControllerLink(port, baud, timeouts)
        try:
            self._prepare()
            self.led_count = len(self.state().levels_percent)
        except BaseException:
            self._link.close()
            raise

    @property
    def identity(self) -> ControllerIdentity:
        """Identity of the controller, as it reports it."""
        return self._link.identity

    @property
    def port(self) -> str:
        """The port of the open line, which `recover` may change."""
        return self._link.port

    def select(self, led: int) -> Switch:
        """Light LED `led`, counted from 0, and no other."""
        answer = self.ask(f"LED:SEL {led}", 2)
        lit, time_us = answer.numbers
        if lit != led:
            raise self._failure(f"asked for LED {led}, it lit LED {lit}")
        return Switch(led, time_us, answer.received_s)

    def off(self) -> Switch:
        """Put all LEDs out."""
        answer = self.ask("LED:OFF", 2)
        lit, time_us = answer.numbers
        if lit != -1:
            raise self._failure(f"asked for all LEDs off, LED {lit} is lit")
        return Switch(None, time_us, answer.received_s)

    def set_level(self, led: int, percent: int) -> None:
        """Set the level of one LED when it is lit, 0 to 100 %."""
        if self.ask(f"LED:LEV {led},{percent}", 2).numbers != (led, percent):
            raise self._failure(f"level {percent} % of LED {led} was not set")
        self._levels_percent[led] = percent

    def state(self) -> _LightState:
        """Ask the controller for the state of its LEDs, which also keeps its watchdog quiet."""
        with self._lock:  # a keep-alive meanwhile would change `_latest_us`
            return self._parsed_state(self._exchange("LED:STAT?"))

    def ask(self, command: str, count: int) -> Answer:
        """Send a command whose reply has `count` numbers."""
        sent_s = self._clock.now_s()
        numbers = self._numbers(self._exchange(command), count)
        return Answer(numbers, sent_s, self._clock.now_s())

    def confirm(self, led: int | None) -> _LightState:
        """Check that `led` (None: no LED) is still lit, and return the whole state.

        Raises
        ------
        LightControllerError
            If the state differs. The message has the oldest entry of the controller's error queue,
            such as a tripped watchdog or the time limit of the LED.
        """
        state = self.state()
        if state.led != led:
            cause = self._exchange("SYST:ERR?").text
            raise self._failure(
                f"{_led_text(led)} should be lit but {_led_text(state.led)} is; the oldest error "
                f"of the controller is {cause}"
            )
        return state

    def trips_watchdog(self) -> bool:
        """Test whether the controller puts an LED out by itself when no command comes.

        During the test, the watchdog is set to `WATCHDOG_MIN_MS`.
        """
        with self._lock:  # excludes a keep-alive
            self._exchange(f"SYST:WDOG {WATCHDOG_MIN_MS}")
            try:
                self.select(0)
                self._clock.sleep_s(3.0 * WATCHDOG_MIN_MS / 1000.0)
                tripped = self.state().led is None
                self._exchange("SYST:ERR?")  # removes the entry of this test
                self.off()
            finally:
                if not self._has_failed:  # else `recover` sets the time again
                    self._exchange(f"SYST:WDOG {self._watchdog_ms}")
        return tripped

    def keep_alive(self) -> None:
        """Start a thread that keeps the watchdog quiet, in real time."""
        if self._keep_alive_thread is None:
            self._keep_alive_thread = KeepAliveThread(self.keep_alive_if_due)

    def keep_alive_if_due(self) -> float:
        """Keep the watchdog quiet if half its time has passed without a command.

        Nothing is sent if the thread that used the lights last has ended, if the lights were not
        used for a long time, or after a failed exchange. The next exchange raises the error of a
        failed keep-alive.

        Returns
        -------
        float
            Seconds until it should be called again.
        """
        if not self._lock.acquire(blocking=False):
            return self._usage.period_s  # the running exchange keeps the watchdog quiet
        try:
            if (due_s := self._usage.due_in_s) > 0.0:
                return due_s
            if self._usage.is_recent and not self._has_failed:
                self._usage.mark_sent()
                try:
                    self._parsed_state(self._ask("LED:STAT?"))
                except LightControllerError as error:
                    self._missed_keep_alive = error
            return self._usage.period_s
        finally:
            self._lock.release()

    def recover(self) -> None:
        """After a failed exchange, find the same controller again and put its LEDs out.

        The port is opened again, remains of earlier exchanges are discarded, and levels are set
        again. Without a failure nothing is done.

        Raises
        ------
        LightControllerError
            If it is not found in time, or another controller is in its place.
        """
        with self._lock:
            if not self._has_failed:
                return
            self._usage.mark_used()
            self._link.close()
            self._link = find_again(self.identity, self._possible_ports, self._baud, self._timeouts)
            self._missed_keep_alive = None
            self._prepare()
            for led, percent in self._levels_percent.items():
                self._exchange(f"LED:LEV {led},{percent}")
            self._has_failed = False

    def put_out(self) -> None:
        """Put all LEDs out, also after an exchange that was interrupted.

        Signals that would end the program are held back until the controller has confirmed.

        Raises
        ------
        LightControllerError
            If it does not confirm. Its watchdog then puts the LEDs out.
        """
        with signals_held_back():
            self._missed_keep_alive = None
            try:
                self.off()
            except LightControllerError:
                # An interrupted write may have left half a line that spoils the first command.
                self._link.end_line()
                self.off()

    def close(self) -> None:
        """Put the LEDs out if the controller still answers, and release the port."""
        with signals_held_back():
            if self._keep_alive_thread is not None:
                self._keep_alive_thread.stop(2.0 * self._timeouts.reply_s)
            try:
                with suppress(LightControllerError):  # the watchdog puts the LEDs out
                    self.put_out()
            finally:
                self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _prepare(self) -> None:
        self._latest_us = 0
        self._exchange("*RST")
        self._exchange(f"SYST:WDOG {self._watchdog_ms}")

    def _parsed_state(self, reply: Reply) -> _LightState:
        # LED, levels and time. The first reply, at opening, determines the number of LEDs.
        count = max(3, reply.text.count(",") + 1)
        led, *levels, time_us = self._numbers(reply, count)
        if self.led_count not in (0, len(levels)):
            raise self._failure(
                f"its state has {len(levels)} LED levels, it had {self.led_count} when it was "
                "opened; open the rig again"
            )
        if time_us < self._latest_us:
            raise self._failure("the controller has restarted: its clock went back")
        self._latest_us = time_us
        return _LightState(None if led == -1 else led, tuple(levels))

    def _failure(self, cause: str) -> LightControllerError:
        """The error for a failed exchange, which `recover` has to follow."""
        self._has_failed = True
        return LightControllerError(f"{self.port}: {cause}")

    def _exchange(self, command: str) -> Reply:
        """Send a command of the program; raise if the controller refuses it."""
        with self._lock:
            self._usage.mark_used()
            if self._missed_keep_alive is not None:
                missed, self._missed_keep_alive = self._missed_keep_alive, None
                raise LightControllerError(f"keep-alive failed: {missed}") from missed
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
            raise self._failure(f"unexpected reply {reply.text!r}")
        return numbers


def _led_text(led: int | None) -> str:
    return "no LED" if led is None else f"LED {led}"


def switch_latencies_ms(lights: LightController, clock: Clock, switches: int = 40) -> list[float]:
    """Switch through all LEDs and off; return each time from command to acknowledgement."""
    latencies_ms = []
    try:
        for number in range(switches):
            led = number % (lights.led_count + 1)
            sent_s = clock.now_s()
            switch = lights.off() if led == lights.led_count else lights.select(led)
            latencies_ms.append(1e3 * (switch.acknowledged_s - sent_s))
    finally:
        lights.off()
    return latencies_ms
