"""The programs that have a device open, as far as /proc shows them."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

_PROC = Path("/proc")
# Processor time of the search, which takes longer on a machine with very many open files.
_LONGEST_S = 1.0


@dataclass(frozen=True)
class PortHolder:
    """A running program that has a device open."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})"


def port_holders(device: str, proc: Path = _PROC) -> list[PortHolder]:
    """List the programs, this one included, that have a device open; other users' may be hidden."""
    target = os.path.realpath(device)
    given_up_s = time.thread_time() + _LONGEST_S
    holders = []
    for process in sorted(proc.glob("[0-9]*"), key=lambda path: int(path.name)):
        if time.thread_time() > given_up_s:
            break
        if _has_open(process, target):
            holders.append(PortHolder(int(process.name), _name(process)))
    return holders


def _has_open(process: Path, target: str) -> bool:
    try:
        return any(
            _target(entry) == target and not _is_of_a_container(entry, target)
            for entry in os.scandir(process / "fd")
        )
    except OSError:  # another user's, or it has just ended
        return False


def _target(entry: os.DirEntry[str]) -> str:
    try:
        return os.readlink(entry.path)  # noqa: PTH115 - a Path per open file takes too long
    except OSError:  # closed since it was listed
        return ""


def _is_of_a_container(entry: os.DirEntry[str], target: str) -> bool:
    """Whether an open pseudo-terminal is of another /dev/pts, which uses the same names."""
    if not target.startswith("/dev/pts/"):
        return False
    try:
        return entry.stat().st_dev != os.stat(target).st_dev  # noqa: PTH116 - as above
    except OSError:  # closed since
        return True


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return "a program"
