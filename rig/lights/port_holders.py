"""Which programs have a device open, as far as /proc lets us see."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

__all__ = ["PortHolder", "port_holders"]

_PROC = Path("/proc")
# On a machine with very many open files the answer is not worth more waiting.
_DEADLINE_S = 1.0


@dataclass(frozen=True)
class PortHolder:
    """A running program that has a device open."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})"


def port_holders(device: str, proc: Path = _PROC) -> list[PortHolder]:
    """The programs that have `device` open, this one included; links to it count as itself.

    Other people's programs are seen by the superuser only, so an empty list does not say that
    nobody has it. Empty as well where there is no /proc.
    """
    wanted = os.path.realpath(device)
    deadline_s = time.monotonic() + _DEADLINE_S
    holders = []
    for process in sorted(proc.glob("[0-9]*"), key=lambda path: int(path.name)):
        if time.monotonic() > deadline_s:
            break
        if _has_open(process, wanted):
            holders.append(PortHolder(int(process.name), _name(process)))
    return holders


def _has_open(process: Path, wanted: str) -> bool:
    try:
        return any(_target(entry) == wanted for entry in os.scandir(process / "fd"))
    except OSError:  # another user's, or it has just ended
        return False


def _target(entry: os.DirEntry[str]) -> str:
    try:
        return os.readlink(entry.path)  # noqa: PTH115 - a Path per open file takes too long
    except OSError:  # closed since it was listed
        return ""


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return "a program"
