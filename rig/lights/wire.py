"""The host's side of the light controller's lines: sequence id and CRC around each.

The protocol itself is written down in ``firmware_sim/README.md``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from firmware_sim import crc8
from firmware_sim.firmware import MAX_SEQUENCE

__all__ = ["BANNER", "MAX_SEQUENCE", "Garbled", "Reply", "decode_reply", "encode_command"]

BANNER = b"READY "

_REPLY = re.compile(rb"(?:#(\d{1,5}) )?(OK|ERR)(?: ([ -~]*))?")


class Garbled(ValueError):  # noqa: N818 - it names the state of a line, and never reaches a user
    """A line that is not an intact reply."""


@dataclass(frozen=True)
class Reply:
    """An intact reply line."""

    sequence: int | None
    ok: bool
    text: str


def encode_command(sequence: int, command: str) -> bytes:
    """``#<sequence> <command>~<crc>`` with its line end."""
    body = f"#{sequence} {command}".encode("ascii")
    return body + b"~%02X\n" % crc8(body)


def decode_reply(line: bytes) -> Reply:
    """Check the CRC and take a reply apart; the line end is not part of `line`.

    Raises
    ------
    Garbled
        Without a CRC, with a wrong one, or if it is no reply at all.
    """
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
