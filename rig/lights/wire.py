"""The host's side of the controller's protocol: lines with sequence id and CRC.

``firmware_sim/README.md`` describes the protocol.
"""

import re
from dataclasses import dataclass

from firmware_sim import crc8

BANNER = b"READY "

_REPLY = re.compile(rb"(?:#(\d{1,5}) )?(OK|ERR)(?: ([ -~]*))?")


class Garbled(ValueError):  # noqa: N818 - the state of a line; users never see it
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
        raise Garbled(line)
    parts = _REPLY.fullmatch(body)
    if parts is None:
        raise Garbled(line)
    sequence, status, text = parts.groups()
    return Reply(
        sequence=None if sequence is None else int(sequence),
        ok=status == b"OK",
        text=(text or b"").decode("ascii"),
    )
