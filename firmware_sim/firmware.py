"""The LED controller's firmware: one file for MicroPython and CPython.

It imports nothing and uses only the board that it is given (see `board.Board`). README.md describes
the protocol; change both together.
"""

TYPE_CHECKING = False  # MicroPython has no typing module; type checkers assume that this is true
if TYPE_CHECKING:
    from collections.abc import Callable

    from .board import Board

FIRMWARE_VERSION = "2.1.0"
PROTOCOL_VERSION = 2

MAX_LINE_BYTES = 64  # without its terminator
MAX_SEQUENCE = 65535
_ERROR_QUEUE_DEPTH = 8
STROBE_BUFFER_EDGES = 16  # capacity of a board between two passes of the main loop
WATCHDOG_DEFAULT_MS = 5000
WATCHDOG_MIN_MS = 100
WATCHDOG_MAX_MS = 60000
MAX_STEPS = 16
MAX_STEP_US = 60000000
DARK = -1  # no LED
_AT_ONCE = -1  # no wait for the part sensor

MESSAGES: dict[int, str] = {}


def _define_error(code: int, text: str) -> int:
    MESSAGES[code] = text
    return code


_NO_ERROR = _define_error(0, "No error")
_WATCHDOG_TRIPPED = _define_error(100, "Watchdog: LEDs off")
_ON_TIME_EXCEEDED = _define_error(110, "On-time limit: LEDs off")
_LED_RESTS = _define_error(111, "LED must rest")
_SEQUENCE_RUNS = _define_error(120, "Sequence is running")
_STROBE_MISSING = _define_error(121, "Strobe missing: LEDs off")
_SEQUENCE_ABORTED = _define_error(122, "Sequence aborted")
# Negative numbers and their texts are those of SCPI.
_INVALID_CHARACTER = _define_error(-101, "Invalid character")
_SYNTAX_ERROR = _define_error(-102, "Syntax error")
_PARAMETER_NOT_ALLOWED = _define_error(-108, "Parameter not allowed")
_MISSING_PARAMETER = _define_error(-109, "Missing parameter")
_UNDEFINED_HEADER = _define_error(-113, "Undefined header")
_OUT_OF_RANGE = _define_error(-222, "Data out of range")
_QUEUE_OVERFLOW = _define_error(-350, "Queue overflow")
_CRC_MISMATCH = _define_error(-360, "Communication error")
_LINE_TOO_LONG = _define_error(-363, "Input buffer overrun")


class _CommandError(Exception):
    """The error of a line that cannot be executed; its argument is the error code."""


def crc8(data: bytes) -> int:
    """CRC-8 with polynomial 0x07, initial value 0, not reflected: 0xF4 for b"123456789"."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ 0x107 if crc & 0x80 else crc << 1
    return crc


class _Leds:
    """The LEDs: at most one is lit. A token bucket limits on-time and duty cycle of each."""

    def __init__(self, board: "Board") -> None:
        self._board = board
        self._updated_us = [board.micros()] * board.led_count  # of the budgets
        self._budgets = [self._full(led) for led in range(board.led_count)]  # in ms x percent
        self.levels_percent = [100] * board.led_count
        self.selected = DARK
        self.exhausted_us = 0  # time at which the budget of the lit LED is used up

    def light(self, led: int) -> int:
        """Light one LED and no other, or with DARK no LED; return the `micros` of the change."""
        if self.selected != DARK:
            self._update_budget(self.selected)
        if led != DARK:
            drain_percent = 100 - self._board.max_duty_percent(led)
            lasts_ms = self._update_budget(led) // drain_percent
            self.exhausted_us = self._updated_us[led] + 1000 * lasts_ms
        self.selected = led
        changed_us = 0
        for other in range(self._board.led_count):
            if other != led:
                changed_us = self._board.set_led(other, 0)
        return changed_us if led == DARK else self._board.set_led(led, self.levels_percent[led])

    def has_rested(self, led: int) -> bool:
        """Whether an LED may be lit: it is lit already, or has at least half of its budget."""
        return led in (DARK, self.selected) or 2 * self._update_budget(led) >= self._full(led)

    def _update_budget(self, led: int) -> int:
        """Drain or refill the budget of an LED for the time since the last call; return it."""
        passed_ms = (self._board.micros() - self._updated_us[led]) // 1000
        self._updated_us[led] += 1000 * passed_ms
        duty_percent = self._board.max_duty_percent(led)
        gain_percent = duty_percent - 100 if led == self.selected else duty_percent
        budget = self._budgets[led] + passed_ms * gain_percent
        self._budgets[led] = min(budget, self._full(led))
        return self._budgets[led]

    def _full(self, led: int) -> int:
        return self._board.max_on_ms(led) * (100 - self._board.max_duty_percent(led))


class _Step:
    """One step of a sequence: its light, and the times of its events, -1 if missing."""

    def __init__(self, led: int, changed_us: int) -> None:
        self.led = led
        self.changed_us = changed_us
        self.triggered_us = self.begin_us = self.end_us = -1  # of the exposure that counts
        self.exposures = 0  # number of exposures that began under this light


class _Sequence:
    """Lights in a given order, one exposure under each; construction starts the sequence.

    An exposure counts if it began after its light had settled. With a delay, the first step starts
    that long after the next edge of the part sensor.
    """

    def __init__(
        self,
        board: "Board",
        leds: _Leds,
        triggers: bool,
        delay_us: int,
        settle_us: int,
        wait_us: int,
        *order: int,
    ) -> None:
        self._board = board
        self._leds = leds
        self._triggers = triggers
        self._settle_us = settle_us
        self._wait_us = wait_us  # time-out of SEQ:ARM, or interval of SEQ:TRIG
        self.order = order
        self.steps: list[_Step] = []
        self.code = _NO_ERROR  # the error that ended it early
        self.running = True
        self._delay_us = delay_us
        self._due_us = -1  # of the first step, once the sensor has seen a part
        self.started_us = self.ended_us = board.micros()
        self._edge_us = self.started_us  # latest edge of the strobe, or the first light
        if delay_us == _AT_ONCE:
            self.started_us = self.ended_us = self._start_step()

    def see_part(self, at_us: int) -> None:
        """Handle an edge of the part sensor."""
        if self._due_us < 0 and at_us >= self.started_us:
            self._due_us = at_us + self._delay_us

    def advance(self) -> bool:
        """Handle new strobe edges and the time; return False if the strobe is missing."""
        for at_us, exposing in self._board.strobe_edges():
            # Edges from before the first light belong to no step.
            if self.running and self.steps and at_us >= self.steps[0].changed_us:
                self._record(at_us, exposing)
        if not self.running:
            return True
        now_us = self._board.micros()
        if not self.steps:
            if 0 <= self._due_us <= now_us:
                self._start_step()
            return True
        if not self._triggers:
            return now_us - self._edge_us < self._wait_us
        step = self.steps[-1]
        if step.triggered_us < 0:
            if now_us - step.changed_us >= self._settle_us:
                step.triggered_us = self._board.trigger()
        elif now_us - step.triggered_us >= self._wait_us - self._settle_us:
            self._start_step()
        return True

    def end(self, code: int) -> int:
        """Put the LEDs out and end with an error code or `_NO_ERROR`; return the `micros`."""
        self.running = False
        self.code = code
        self.ended_us = self._leds.light(DARK)
        return self.ended_us

    def _record(self, at_us: int, exposing: bool) -> None:
        self._edge_us = at_us
        step = self.steps[-1]
        if exposing:
            step.exposures += 1
            if step.begin_us < 0 and at_us - step.changed_us >= self._settle_us:
                step.begin_us = at_us
        elif step.begin_us >= 0 and step.end_us < 0:
            step.end_us = at_us
            if not self._triggers:
                self._start_step()

    def _start_step(self) -> int:
        if len(self.steps) == len(self.order):
            return self.end(_NO_ERROR)
        led = self.order[len(self.steps)]
        self.steps.append(_Step(led, self._leds.light(led)))
        if len(self.steps) == 1:
            self._edge_us = self.steps[0].changed_us
        return self.steps[-1].changed_us


class Firmware:
    """The controller's program on one board; construction is its start after a reset."""

    def __init__(self, board: "Board") -> None:
        self._board = board
        self._line = b""
        self._leds = _Leds(board)
        self._errors: list[int] = []
        self._watchdog_ms = WATCHDOG_DEFAULT_MS
        self._fed_us = board.micros()  # time of the command that fed the watchdog last
        self._parts = 0  # number of parts that the sensor has seen since the boot
        self._part_us = -1  # time of the latest part
        self.stopped = False  # set when the host wants to flash the board
        # header: (smallest and largest number of parameters, handler)
        self._commands: dict[str, tuple[int, int, Callable[..., str]]] = {
            "*IDN?": (0, 0, self._identity),
            "*RST": (0, 0, self._reset),
            "SYST:ERR?": (0, 0, self._oldest_error),
            "SYST:PROG": (0, 0, self._stop),
            "SYST:WDOG": (1, 1, self._set_watchdog),
            "SYST:WDOG?": (0, 0, self._watchdog),
            "LED:SEL": (1, 1, self._select),
            "LED:OFF": (0, 0, self._off),
            "LED:LEV": (2, 2, self._set_level),
            "LED:LEV?": (1, 1, self._level),
            "LED:LIM?": (1, 1, self._limits),
            "LED:STAT?": (0, 0, self._led_status),
            "PART:WAIT": (1, 1, self._wait_for_part),
            "PART:STAT?": (0, 0, self._part_status),
            "SEQ:ARM": (3, 2 + MAX_STEPS, lambda *numbers: self._start(False, *numbers)),
            "SEQ:TRIG": (3, 2 + MAX_STEPS, lambda *numbers: self._start(True, *numbers)),
            "SEQ:STAT?": (0, 0, self._sequence_status),
            "SEQ:STEP?": (1, 1, self._step),
        }
        self._reset()
        self._send("READY " + self._identity())

    def poll(self) -> None:
        """Run one pass of the main loop: advance the sequence, execute lines, check the limits."""
        for at_us in self._board.part_edges():
            self._parts += 1
            self._part_us = at_us
            self.sequence.see_part(at_us)
        if not self.sequence.advance():
            self._darken(_STROBE_MISSING)
        data = self._board.read()
        if data:
            self._receive(data)
        if self._leds.selected == DARK and not self.sequence.running:
            return
        now_us = self._board.micros()
        if self._leds.selected != DARK and now_us >= self._leds.exhausted_us:
            self._darken(_ON_TIME_EXCEEDED)
        elif now_us - self._fed_us >= 1000 * self._watchdog_ms:
            self._darken(_WATCHDOG_TRIPPED)

    # Lines

    def _receive(self, data: bytes) -> None:
        start = 0
        end = data.find(b"\n")
        while end >= 0:
            self._collect(data[start:end])
            line = self._line[:-1] if self._line.endswith(b"\r") else self._line
            self._line = b""
            self._send(self._reply_to(line))
            start = end + 1
            end = data.find(b"\n", start)
        self._collect(data[start:])

    def _collect(self, piece: bytes) -> None:
        # Two bytes more than a line: a carriage return, and a byte that shows an overlong line.
        self._line += piece[: MAX_LINE_BYTES + 2 - len(self._line)]

    def _send(self, line: str) -> None:
        self._board.write((line + "\n").encode())

    def _reply_to(self, line: bytes) -> str:
        """Check and remove the checksum of a line; the reply gets one if the line had one."""
        if len(line) > MAX_LINE_BYTES:
            return self._error(_LINE_TOO_LONG)
        line = line.rstrip(b" ")
        mark = line.rfind(b"~")
        if mark < 0:
            return self._answer(line)
        message = line[:mark]
        if line[mark + 1 :].upper() == f"{crc8(message):02X}".encode():
            reply = self._answer(message)
        else:
            reply = self._error(_CRC_MISMATCH)  # without a sequence id, which may be damaged too
        return f"{reply}~{crc8(reply.encode()):02X}"

    def _answer(self, message: bytes) -> str:
        """Execute a message; the reply starts with its sequence id, if it has one."""
        message = message.strip(b" ")
        if not message.startswith(b"#"):
            return self._ok_or_error(message)
        blank = message.find(b" ")
        if blank < 0:
            blank = len(message)
        sequence_id = message[1:blank]
        if not sequence_id.isdigit():
            return self._error(_SYNTAX_ERROR)
        if int(sequence_id.decode()) > MAX_SEQUENCE:
            return self._error(_OUT_OF_RANGE)
        return "#" + sequence_id.decode() + " " + self._ok_or_error(message[blank:].strip(b" "))

    def _ok_or_error(self, command: bytes) -> str:
        try:
            fields = self._execute(command)
        except _CommandError as error:
            return self._error(error.args[0])
        self._fed_us = self._board.micros()  # only accepted commands feed the watchdog
        return "OK " + fields if fields else "OK"

    def _execute(self, command: bytes) -> str:
        """Execute a command such as b"led:lev 2,50"; return the fields of its reply."""
        for byte in command:
            if byte < 0x20 or byte > 0x7E:
                raise _CommandError(_INVALID_CHARACTER)
        text = command.decode().upper()
        if not text:
            raise _CommandError(_SYNTAX_ERROR)
        blank = text.find(" ")
        header = text if blank < 0 else text[:blank]
        if header not in self._commands:
            raise _CommandError(_UNDEFINED_HEADER)
        min_count, max_count, handler = self._commands[header]
        return handler(*_parameters(text[len(header) :].strip(), min_count, max_count))

    def _error(self, code: int) -> str:
        self._queue(code)
        return "ERR " + _describe(code)

    def _queue(self, code: int) -> None:
        if len(self._errors) < _ERROR_QUEUE_DEPTH:
            self._errors.append(code)
        else:
            self._errors[-1] = _QUEUE_OVERFLOW

    # Commands

    def _identity(self) -> str:
        board = self._board
        model = f"LED{board.led_count}"
        return f"PS4RIG,{model},{board.serial_number},{FIRMWARE_VERSION},{PROTOCOL_VERSION}"

    def _reset(self) -> str:
        self._leds.levels_percent = [100] * self._board.led_count
        self._errors = []
        # A sequence without steps turns the LEDs off.
        self.sequence = _Sequence(self._board, self._leds, False, _AT_ONCE, 0, 0)
        self._delay_us = _AT_ONCE  # of the next sequence
        self._watchdog_ms = WATCHDOG_DEFAULT_MS
        return ""

    def _stop(self) -> str:
        self._off()
        self.stopped = True
        return ""

    def _oldest_error(self) -> str:
        return _describe(self._errors.pop(0) if self._errors else _NO_ERROR)

    def _set_watchdog(self, watchdog_ms: int) -> str:
        _require(WATCHDOG_MIN_MS <= watchdog_ms <= WATCHDOG_MAX_MS)
        self._watchdog_ms = watchdog_ms
        return self._watchdog()

    def _watchdog(self) -> str:
        return str(self._watchdog_ms)

    def _select(self, led: int) -> str:
        self._require_led(led)
        self._require_switchable(led)
        return f"{led},{self._leds.light(led)}"

    def _off(self) -> str:
        if self.sequence.running:
            self.sequence.end(_SEQUENCE_ABORTED)
        return f"{DARK},{self._leds.light(DARK)}"

    def _set_level(self, led: int, percent: int) -> str:
        self._require_led(led)
        _require(0 <= percent <= 100)
        self._require_switchable(DARK)
        self._leds.levels_percent[led] = percent
        if led == self._leds.selected:
            self._leds.light(led)
        return self._level(led)

    def _level(self, led: int) -> str:
        self._require_led(led)
        return f"{led},{self._leds.levels_percent[led]}"

    def _limits(self, led: int) -> str:
        self._require_led(led)
        return _fields([led, self._board.max_on_ms(led), self._board.max_duty_percent(led)])

    def _led_status(self) -> str:
        levels = _fields(self._leds.levels_percent)
        return f"{self._leds.selected},{levels},{self._board.micros()}"

    def _start(self, triggers: bool, settle_us: int, wait_us: int, *order: int) -> str:
        _require(0 <= settle_us < wait_us <= MAX_STEP_US)
        for led in order:
            if led != DARK:
                self._require_led(led)
            self._require_switchable(led)
        delay_us, self._delay_us = self._delay_us, _AT_ONCE
        self.sequence = _Sequence(
            self._board, self._leds, triggers, delay_us, settle_us, wait_us, *order
        )
        return str(self.sequence.started_us)

    def _wait_for_part(self, delay_us: int) -> str:
        _require(0 <= delay_us <= MAX_STEP_US)
        self._require_switchable(DARK)
        self._delay_us = delay_us
        return str(delay_us)

    def _part_status(self) -> str:
        return _fields([self._parts, self._part_us, self._board.micros()])

    def _sequence_status(self) -> str:
        sequence = self.sequence
        now_us = self._board.micros()
        passed_us = (now_us if sequence.running else sequence.ended_us) - sequence.started_us
        counts = _fields(
            [int(sequence.running), len(sequence.steps), len(sequence.order), sequence.code]
        )
        return f"{counts},{sequence.started_us},{passed_us},{now_us}"

    def _step(self, index: int) -> str:
        _require(0 <= index < len(self.sequence.steps))
        step = self.sequence.steps[index]
        times_us = [step.changed_us, step.triggered_us, step.begin_us, step.end_us]
        since_us = [-1 if at_us < 0 else at_us - self.sequence.started_us for at_us in times_us]
        return f"{step.led},{_fields(since_us)},{step.exposures}"

    def _require_led(self, led: int) -> None:
        _require(0 <= led < self._board.led_count)

    def _require_switchable(self, led: int) -> None:
        if self.sequence.running:
            raise _CommandError(_SEQUENCE_RUNS)
        if not self._leds.has_rested(led):
            raise _CommandError(_LED_RESTS)

    def _darken(self, code: int) -> None:
        """Put the LEDs out for an error, which ends a sequence and goes into the queue."""
        if self.sequence.running:
            self.sequence.end(code)
        self._leds.light(DARK)
        self._queue(code)


def _parameters(text: str, min_count: int, max_count: int) -> list[int]:
    """Parse decimal integers such as "2,50"; the only negative one is -1, for DARK."""
    words = [word.strip() for word in text.split(",")] if text else []
    if len(words) > max_count:
        raise _CommandError(_PARAMETER_NOT_ALLOWED)
    if len(words) < min_count or "" in words:
        raise _CommandError(_MISSING_PARAMETER)
    for word in words:
        if word != "-1" and not word.isdigit():  # int() accepts signs, blanks and underscores
            raise _CommandError(_SYNTAX_ERROR)
    return [int(word) for word in words]


def _require(in_range: bool) -> None:
    if not in_range:
        raise _CommandError(_OUT_OF_RANGE)


def _fields(numbers: list[int]) -> str:
    return ",".join([str(number) for number in numbers])


def _describe(code: int) -> str:
    return f'{code},"{MESSAGES[code]}"'
