"""The LED controller's firmware: this one file runs unchanged on MicroPython and on CPython.

It imports nothing and knows only the board it is given (see `board.Board`). The protocol is
written down in README.md; change both together.
"""

TYPE_CHECKING = False  # MicroPython has no typing module; a type checker takes this name as true
if TYPE_CHECKING:
    from collections.abc import Callable

    from .board import Board

FIRMWARE_VERSION = "1.0.0"
PROTOCOL_VERSION = 1

MAX_LINE_BYTES = 64  # without its terminator
MAX_SEQUENCE = 65535
QUEUE_DEPTH = 8
STROBE_BUFFER_EDGES = 16  # what a board keeps for the firmware between two turns of its loop
WATCHDOG_DEFAULT_MS = 5000
WATCHDOG_MIN_MS = 100
WATCHDOG_MAX_MS = 60000

NO_ERROR = 0
WATCHDOG_TRIPPED = 100
INVALID_CHARACTER = -101
SYNTAX_ERROR = -102
PARAMETER_NOT_ALLOWED = -108
MISSING_PARAMETER = -109
UNDEFINED_HEADER = -113
OUT_OF_RANGE = -222
QUEUE_OVERFLOW = -350
CRC_MISMATCH = -360
LINE_TOO_LONG = -363

# the negative numbers and their texts are those of SCPI
MESSAGES = {
    NO_ERROR: "No error",
    WATCHDOG_TRIPPED: "Watchdog: LEDs off",
    INVALID_CHARACTER: "Invalid character",
    SYNTAX_ERROR: "Syntax error",
    PARAMETER_NOT_ALLOWED: "Parameter not allowed",
    MISSING_PARAMETER: "Missing parameter",
    UNDEFINED_HEADER: "Undefined header",
    OUT_OF_RANGE: "Data out of range",
    QUEUE_OVERFLOW: "Queue overflow",
    CRC_MISMATCH: "Communication error",
    LINE_TOO_LONG: "Input buffer overrun",
}


class CommandError(Exception):
    """A line that cannot be executed; its argument is the error code."""


def crc8(data: bytes) -> int:
    """CRC-8 with polynomial 0x07, initial value 0, not reflected: 0xF4 for b"123456789"."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ 0x107 if crc & 0x80 else crc << 1
    return crc


class Firmware:
    """The controller's program on one board; construction is the start after a reset.

    Parameters
    ----------
    board
        LEDs, microsecond clock and serial bytes; the firmware knows nothing else.
    """

    def __init__(self, board: "Board") -> None:
        self._board = board
        self._line = b""
        self._selected = -1
        self._levels_percent: list[int] = []
        self._errors: list[int] = []
        self._watchdog_ms = WATCHDOG_DEFAULT_MS
        self._fed_us = board.micros()
        # header: (number of parameters, what executes it)
        self._commands: dict[str, tuple[int, Callable[..., str]]] = {
            "*IDN?": (0, self._identity),
            "*RST": (0, self._reset),
            "SYST:ERR?": (0, self._oldest_error),
            "SYST:WDOG": (1, self._set_watchdog),
            "SYST:WDOG?": (0, self._watchdog),
            "LED:SEL": (1, self._select),
            "LED:OFF": (0, self._off),
            "LED:LEV": (2, self._set_level),
            "LED:LEV?": (1, self._level),
            "LED:STAT?": (0, self._state),
        }
        self._reset()
        self._send("READY " + self._identity())

    def poll(self) -> None:
        """One turn of the main loop: take what arrived, execute whole lines, check the watchdog."""
        data = self._board.read()
        if data:
            self._receive(data)
        if self._selected >= 0:
            self._check_watchdog()

    # lines

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
        # one byte for a carriage return and one more: enough to tell that a line was too long
        self._line += piece[: MAX_LINE_BYTES + 2 - len(self._line)]

    def _send(self, line: str) -> None:
        self._board.write((line + "\n").encode())

    def _reply_to(self, line: bytes) -> str:
        """The reply to one line: the checksum off its end, and one on the reply if it had one."""
        if len(line) > MAX_LINE_BYTES:
            return self._error(LINE_TOO_LONG)
        line = line.rstrip(b" ")
        mark = line.rfind(b"~")
        if mark < 0:
            return self._answer(line)
        message = line[:mark]
        if line[mark + 1 :].upper() == f"{crc8(message):02X}".encode():
            reply = self._answer(message)
        else:
            reply = self._error(CRC_MISMATCH)  # no sequence id: it cannot be trusted either
        return f"{reply}~{crc8(reply.encode()):02X}"

    def _answer(self, message: bytes) -> str:
        """The reply to a message: the sequence id off its front and back on the reply's front."""
        message = message.strip(b" ")
        if not message.startswith(b"#"):
            return self._run(message)
        blank = message.find(b" ")
        if blank < 0:
            blank = len(message)
        sequence = message[1:blank]
        if not sequence.isdigit():
            return self._error(SYNTAX_ERROR)
        if int(sequence.decode()) > MAX_SEQUENCE:
            return self._error(OUT_OF_RANGE)
        return "#" + sequence.decode() + " " + self._run(message[blank:].strip(b" "))

    def _run(self, command: bytes) -> str:
        try:
            fields = self._execute(command)
        except CommandError as error:
            return self._error(error.args[0])
        self._fed_us = self._board.micros()  # only what was accepted feeds the watchdog
        return "OK " + fields if fields else "OK"

    def _execute(self, command: bytes) -> str:
        """Execute a command such as b"led:lev 2,50"; return the fields of its reply."""
        for byte in command:
            if byte < 0x20 or byte > 0x7E:
                raise CommandError(INVALID_CHARACTER)
        text = command.decode().upper()
        if not text:
            raise CommandError(SYNTAX_ERROR)
        blank = text.find(" ")
        header = text if blank < 0 else text[:blank]
        if header not in self._commands:
            raise CommandError(UNDEFINED_HEADER)
        count, handler = self._commands[header]
        return handler(*_numbers(text[len(header) :].strip(), count))

    def _error(self, code: int) -> str:
        self._queue(code)
        return "ERR " + _describe(code)

    def _queue(self, code: int) -> None:
        if len(self._errors) < QUEUE_DEPTH:
            self._errors.append(code)
        else:
            self._errors[-1] = QUEUE_OVERFLOW

    # commands

    def _identity(self) -> str:
        board = self._board
        model = f"LED{board.led_count}"
        return f"PS4RIG,{model},{board.serial_number},{FIRMWARE_VERSION},{PROTOCOL_VERSION}"

    def _reset(self) -> str:
        self._switch_all_off()
        self._levels_percent = [100] * self._board.led_count
        self._watchdog_ms = WATCHDOG_DEFAULT_MS
        self._errors = []
        return ""

    def _oldest_error(self) -> str:
        return _describe(self._errors.pop(0) if self._errors else NO_ERROR)

    def _set_watchdog(self, watchdog_ms: int) -> str:
        _require(WATCHDOG_MIN_MS <= watchdog_ms <= WATCHDOG_MAX_MS)
        self._watchdog_ms = watchdog_ms
        return self._watchdog()

    def _watchdog(self) -> str:
        return str(self._watchdog_ms)

    def _select(self, led: int) -> str:
        _require(led < self._board.led_count)
        for other in range(self._board.led_count):
            if other != led:
                self._board.set_led(other, 0)
        self._selected = led
        changed_us = self._board.set_led(led, self._levels_percent[led])
        return f"{led},{changed_us}"

    def _off(self) -> str:
        return f"-1,{self._switch_all_off()}"

    def _set_level(self, led: int, percent: int) -> str:
        _require(led < self._board.led_count and percent <= 100)
        self._levels_percent[led] = percent
        if led == self._selected:
            self._board.set_led(led, percent)
        return self._level(led)

    def _level(self, led: int) -> str:
        _require(led < self._board.led_count)
        return f"{led},{self._levels_percent[led]}"

    def _state(self) -> str:
        levels = ",".join([str(percent) for percent in self._levels_percent])
        return f"{self._selected},{levels},{self._board.micros()}"

    # LEDs

    def _switch_all_off(self) -> int:
        """Put all LEDs out; return the time at which the last one changed, in microseconds."""
        changed_us = 0
        for led in range(self._board.led_count):
            changed_us = self._board.set_led(led, 0)
        self._selected = -1
        return changed_us

    def _check_watchdog(self) -> None:
        if self._board.micros() - self._fed_us >= self._watchdog_ms * 1000:
            self._switch_all_off()
            self._queue(WATCHDOG_TRIPPED)


def _numbers(text: str, count: int) -> list[int]:
    """Exactly `count` unsigned decimal integers from text such as "2,50"."""
    words = [word.strip() for word in text.split(",")] if text else []
    if len(words) > count:
        raise CommandError(PARAMETER_NOT_ALLOWED)
    if len(words) < count or "" in words:
        raise CommandError(MISSING_PARAMETER)
    for word in words:
        if not word.isdigit():  # int() would let signs, blanks and underscores pass
            raise CommandError(SYNTAX_ERROR)
    return [int(word) for word in words]


def _require(in_range: bool) -> None:
    if not in_range:
        raise CommandError(OUT_OF_RANGE)


def _describe(code: int) -> str:
    return f'{code},"{MESSAGES[code]}"'
