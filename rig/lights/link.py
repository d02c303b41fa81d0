"""One open line to a light controller: protocol, identity, and one reply to each command.

``firmware_sim/README.md`` describes the protocol: lines with sequence id and CRC.
"""

import re
import secrets
from contextlib import suppress
from dataclasses import dataclass

from firmware_sim import crc8
from firmware_sim.firmware import MAX_SEQUENCE, PROTOCOL_VERSION
from rig.errors import LightControllerError

from .serial_line import ReplyTimeout, SerialLine

_BANNER = b"READY "

_REPLY = re.compile(rb"(?:#(\d{1,5}) )?(OK|ERR)(?: ([ -~]*))?")


class GarbledReplyError(ValueError):
    """A line that is not an intact reply."""


@dataclass(frozen=True)
class Reply:
    """An intact reply line."""

    sequence: int | None
    ok: bool
    text: str


def encode_command(sequence: int, command: str) -> bytes:
    """Encode a command as ``#<sequence> <command>~<crc>`` with its line end."""
    body = f"#{sequence} {command}".encode("ascii")
    return body + b"~%02X\n" % crc8(body)


def decode_reply(line: bytes) -> Reply:
    """Check the CRC of a reply line without its line end, and parse it."""
    body, mark, crc = line.rpartition(b"~")
    if not mark or not re.fullmatch(rb"[0-9A-F]{2}", crc) or int(crc, 16) != crc8(body):
        raise GarbledReplyError(line)
    parts = _REPLY.fullmatch(body)
    if parts is None:
        raise GarbledReplyError(line)
    sequence, status, text = parts.groups()
    return Reply(
        sequence=None if sequence is None else int(sequence),
        ok=status == b"OK",
        text=(text or b"").decode("ascii"),
    )


_VENDOR = "PS4RIG"
# Time-out of a write, in time-outs of a reply: it also counts time in which a busy computer does
# not run this program (test_driver.py).
_WRITE_TIMEOUT_REPLIES = 20.0
_SIMULATED_PREFIX = "SIM-"  # of a simulated board's serial number


@dataclass(frozen=True)
class LinkTimeouts:
    """Time-outs in seconds of real time, except `unused_s`, which is on the rig's clock."""

    open_s: float = 3.0  # first answer; an Arduino that resets when opened takes 2 s
    reply_s: float = 0.5  # the firmware takes milliseconds; a write may take 20 times as long
    recover_s: float = 5.0  # Linux needs a second or two for the port of a board plugged in again
    unused_s: float = 600.0  # a program silent for this long hangs: its keep-alive ends


DEFAULT_TIMEOUTS = LinkTimeouts()


@dataclass(frozen=True)
class ControllerIdentity:
    """Identity of a controller, as it reports it."""

    vendor: str
    model: str
    serial_number: str
    firmware_version: str
    protocol_version: int

    @property
    def is_simulated(self) -> bool:
        """Whether it is the firmware on a simulated board, on any kind of line."""
        return self.serial_number.startswith(_SIMULATED_PREFIX)


class ControllerLink:
    """An exclusively opened port on which a light controller has identified itself.

    Before that, only an empty line and ``*IDN?`` are written.
    """

    def __init__(
        self,
        port: str,
        baud: int = 115_200,
        timeouts: LinkTimeouts = DEFAULT_TIMEOUTS,
        *,
        any_protocol: bool = False,
    ) -> None:
        self._any_protocol = any_protocol
        # Random, so that late replies to an earlier program do not match a command of this one.
        self._sequence = secrets.randbelow(MAX_SEQUENCE) + 1
        self._reply_s = timeouts.reply_s
        self._line = SerialLine(port, baud, _WRITE_TIMEOUT_REPLIES * timeouts.reply_s)
        try:
            self.identity = self._identify(timeouts.open_s)
        except BaseException:
            self._line.close()
            raise

    @property
    def port(self) -> str:
        return self._line.port

    def ask(self, command: str) -> Reply:
        """Send a command and return its reply, which may be a refusal."""
        return self._reply_to(command, self._send(command))

    def end_line(self) -> None:
        """End the half line that an interrupted write may have left, and take its reply."""
        self._line.write(b"\n")
        self._line.read_line(ReplyTimeout(self._reply_s))

    def close(self) -> None:
        """Release the port; never raises, and may be called again."""
        self._line.close()

    def _identify(self, timeout_s: float) -> ControllerIdentity:
        """Ask for the identity until it comes, since opening the port may restart the board."""
        left_s = timeout_s
        # Ends a half line that a previous program may have left in the controller.
        self._line.write(b"\n")
        last_line = b""
        while left_s > 0.0:
            sequence = self._send("*IDN?")
            attempt_s = min(left_s, self._reply_s)
            timeout = ReplyTimeout(attempt_s)
            while (line := self._line.read_line(timeout)) is not None:
                last_line = line
                if line.startswith(_BANNER):
                    break  # the controller has just started and lost the command: ask again
                with suppress(GarbledReplyError):
                    reply = decode_reply(line)
                    if reply.sequence == sequence and reply.ok:
                        return self._checked_identity(reply.text)
            left_s -= attempt_s - timeout.left_s
        if last_line:
            text = last_line[:40].decode("ascii", "replace")
            raise LightControllerError(
                f"{self.port}: no intact answer to *IDN? in {timeout_s:g} s; this is not a "
                f"light controller, or the line is bad (it sent {text!r})"
            )
        raise LightControllerError(
            f"{self.port}: no answer in {timeout_s:g} s; is this the light controller, and "
            "does it have power?"
        )

    def _checked_identity(self, text: str) -> ControllerIdentity:
        fields = text.split(",")
        if len(fields) < 5 or fields[0] != _VENDOR or not fields[4].isdigit():
            raise LightControllerError(
                f"{self.port}: this is not a {_VENDOR} light controller (it is {text!r})"
            )
        vendor, model, serial_number, firmware_version, protocol = fields[:5]
        identity = ControllerIdentity(vendor, model, serial_number, firmware_version, int(protocol))
        if identity.protocol_version != PROTOCOL_VERSION and not self._any_protocol:
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

    def _reply_to(self, command: str, sequence: int) -> Reply:
        timeout = ReplyTimeout(self._reply_s)
        while (line := self._line.read_line(timeout)) is not None:
            if line.startswith(_BANNER):
                raise LightControllerError(
                    f"{self.port}: the controller restarted before it answered {command!r}"
                )
            try:
                reply = decode_reply(line)
            except GarbledReplyError as error:
                raise LightControllerError(
                    f"{self.port}: garbled reply to {command!r}: {line[:40]!r}"
                ) from error
            # A late reply to an earlier exchange has another sequence number. A refusal without a
            # number answers a command that arrived damaged.
            if reply.sequence == sequence or (reply.sequence is None and not reply.ok):
                return reply
        raise LightControllerError(
            f"{self.port}: no answer to {command!r} in {self._reply_s:g} s; "
            "the controller hangs or has lost power"
        )
