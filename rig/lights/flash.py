"""The firmware onto a board: over MicroPython's prompt, or into the folder of a board's drive.

Files are put beside the old ones, read back, and take their places in the end, `main.py` last: a
copy that breaks off leaves the old program or none, and never half of one.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

import firmware_sim
from classify.errors import InputError
from rig.errors import LightControllerError

from .discovery import SerialPort, list_serial_ports
from .link import ControllerIdentity, ControllerLink
from .port_holders import port_holders

__all__ = [
    "BoardFile",
    "Flashed",
    "board_files",
    "find_board",
    "find_drives",
    "firmware_version",
    "flash_folder",
    "flash_port",
]

T = TypeVar("T")
_PICO_WITH_MICROPYTHON = "2e8a:0005"
_UNFINISHED = ".new"
_STEP_TIMEOUT_S = 60.0
# From the order to reset: the USB port goes and comes back.
_RESET_S = 1.0
_RESTART_TIMEOUT_S = 15.0
_MOUNTS = Path("/proc/self/mounts")
# Files by which a drive is known.
_BOOT_LOADER = "INFO_UF2.TXT"
_CIRCUIT_PYTHON = "boot_out.txt"
_SHA256 = re.compile(r"^[0-9a-f]{64}$", re.MULTILINE)
_VERSION = re.compile(rb'^FIRMWARE_VERSION = "([0-9A-Za-z.+-]{1,32})"', re.MULTILINE)


@dataclass(frozen=True)
class BoardFile:
    """A file as it is to stand on the board."""

    name: str
    path: Path
    data: bytes

    @property
    def sha256(self) -> str:
        """Of its bytes, in hexadecimal digits."""
        return hashlib.sha256(self.data).hexdigest()


@dataclass(frozen=True)
class Flashed:
    """What was put where; versions are the firmware's, None where there was none or none ran."""

    where: str
    before: str | None
    after: str | None


def board_files() -> tuple[BoardFile, ...]:
    """The files of a Raspberry Pi Pico, in the order in which they are put."""
    room = Path(firmware_sim.__file__).parent
    paths = (room / "firmware.py", room / "pico" / "pico_board.py", room / "pico" / "main.py")
    return tuple(BoardFile(path.name, path, path.read_bytes()) for path in paths)


def firmware_version(source: bytes) -> str | None:
    """The version that a firmware file says of itself."""
    found = _VERSION.search(source)
    return found[1].decode() if found else None


def flash_folder(folder: Path, files: Sequence[BoardFile], *, dry_run: bool = False) -> Flashed:
    """Put files into the folder that a MicroPython board shows as its drive.

    Raises
    ------
    InputError
        If the folder is no such drive; the message says what to do.
    HardwareError
        If what is read back differs.
    """
    _refuse_other_drives(folder)
    before = _version_in(folder)
    if dry_run:
        return Flashed(str(folder), before, before)
    for file in files:
        with (folder / (file.name + _UNFINISHED)).open("wb") as unfinished:
            unfinished.write(file.data)
            unfinished.flush()
            os.fsync(unfinished.fileno())
    read = [(folder / (file.name + _UNFINISHED)).read_bytes() for file in files]
    _compare(files, [hashlib.sha256(data).hexdigest() for data in read])
    for file in files:
        (folder / (file.name + _UNFINISHED)).replace(folder / file.name)
        _sync(folder)
    return Flashed(str(folder), before, _version_in(folder))


def flash_port(
    port: str, files: Sequence[BoardFile], *, baud: int = 115_200, dry_run: bool = False
) -> Flashed:
    """Put files on the MicroPython board at a serial port, and start them.

    A light controller that runs there is stopped first; whatever else runs there is interrupted.

    Raises
    ------
    InputError
        If mpremote is missing.
    LightControllerError
        If the port is in use, there is no MicroPython for a Pico, or what is read back differs.
    """
    if find_spec("mpremote") is None:
        raise InputError("flashing over a serial port needs mpremote: pip install 'ps4rig[flash]'")
    if holders := port_holders(port):
        raise LightControllerError(f"{port}: in use by {holders[0]}; close that first")
    # The device's number may change when the board resets.
    port = next((each.by_id or port for each in list_serial_ports() if each.device == port), port)
    running = _running_controller(port, baud, stop=not dry_run)
    before = running.firmware_version if running else None
    if dry_run:
        return Flashed(port, before, before)
    _wait_for_prompt(port)
    try:
        _put(port, files)
    except LightControllerError:
        with suppress(LightControllerError):
            _on_board(port, "reset")  # what was there before runs again
        raise
    _on_board(port, "reset")
    time.sleep(_RESET_S)
    return Flashed(port, before, _started(port, baud).firmware_version)


def find_board(ports: Sequence[SerialPort]) -> str:
    """The port of the one Raspberry Pi Pico with MicroPython among `ports`.

    Nothing else is taken for one: what runs at a port is interrupted before it is flashed.

    Raises
    ------
    LightControllerError
        If there is none, or more than one.
    """
    boards = [port for port in ports if port.usb_id == _PICO_WITH_MICROPYTHON]
    if len(boards) == 1:
        return boards[0].device
    if boards:
        named = ", ".join(str(port) for port in boards)
        raise LightControllerError(
            f"{len(boards)} boards are plugged in: {named}; give one as --port"
        )
    found = ", ".join(str(port) for port in ports) or "there are no serial ports"
    raise LightControllerError(
        f"no Raspberry Pi Pico with MicroPython was found ({found}); is it plugged in, and has it "
        "got MicroPython? Another board's port can be given as --port"
    )


def find_drives() -> list[Path]:
    """Mounted drives of boards, boot loaders included; where the system lists its mounts."""
    try:
        mounts = _MOUNTS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    fields = [line.split() for line in mounts]
    folders = [Path(each[1].replace("\\040", " ")) for each in fields if each[2] == "vfat"]
    return [folder for folder in folders if _is_boards(folder)]


def _put(port: str, files: Sequence[BoardFile]) -> None:
    _on_board(port, "exec", "import rp2")  # the pins of another kind of board are not ours to drive
    names = [file.name for file in files]
    for file in files:
        _on_board(port, "fs", "cp", "-f", str(file.path), f":{file.name}{_UNFINISHED}")
    _compare(files, _hashes(port, [name + _UNFINISHED for name in names]))
    renames = [f"os.rename({name + _UNFINISHED!r}, {name!r})" for name in names]
    _on_board(port, "exec", "; ".join(["import os", *renames]))
    _compare(files, _hashes(port, names))


def _hashes(port: str, names: Sequence[str]) -> list[str]:
    return _SHA256.findall(_on_board(port, "fs", "sha256sum", *(f":{name}" for name in names)))


def _compare(files: Sequence[BoardFile], read_back: Sequence[str]) -> None:
    expected = [file.sha256 for file in files]
    if list(read_back) != expected:
        names = ", ".join(file.name for file in files)
        raise LightControllerError(
            f"what was read back from the board is not what was put there ({names}); is its memory "
            "full? Flash it again, or erase it and put MicroPython on it anew"
        )


def _running_controller(port: str, baud: int, *, stop: bool) -> ControllerIdentity | None:
    """The light controller that runs at a port, if one does, and its end."""
    try:
        link = ControllerLink(port, baud, any_protocol=True)
    except LightControllerError:
        return None  # at its prompt, or another program runs: mpremote will see
    try:
        if stop and not link.ask("SYST:PROG").ok:
            raise LightControllerError(f"{port}: the controller does not let go of its program")
    finally:
        link.close()
    return link.identity


def _wait_for_prompt(port: str) -> None:
    time.sleep(_RESET_S)
    _until_ready(lambda: _on_board(port, "exec", "pass"))


def _started(port: str, baud: int) -> ControllerIdentity:
    def ask() -> ControllerIdentity:
        link = ControllerLink(port, baud)
        link.close()
        return link.identity

    return _until_ready(ask)


def _until_ready(attempt: Callable[[], T]) -> T:
    """Repeat until it succeeds, as long as a board takes to restart."""
    deadline_s = time.monotonic() + _RESTART_TIMEOUT_S
    while True:
        try:
            return attempt()
        except LightControllerError:
            if time.monotonic() > deadline_s:
                raise
        time.sleep(0.2)


def _on_board(port: str, *words: str) -> str:
    """What `mpremote` says when it does something at MicroPython's prompt."""
    command = [sys.executable, "-m", "mpremote", "connect", port, "resume", *words]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_STEP_TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        raise LightControllerError(
            f"{port}: the board did not finish in {_STEP_TIMEOUT_S:g} s; unplug it, hold its "
            "service pin low, plug it in and flash it again"
        ) from None
    if done.returncode != 0:
        said = (done.stdout + done.stderr).strip().splitlines()
        raise LightControllerError(
            f"{port}: no MicroPython for a Raspberry Pi Pico is there, or it refused: "
            f"{said[-1] if said else 'mpremote failed'}"
        )
    return done.stdout


def _refuse_other_drives(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; is the board's drive mounted?")
    if (folder / _BOOT_LOADER).exists():
        raise InputError(
            f"{folder} is a board's boot loader, which takes UF2 files only. Copy MicroPython's "
            "UF2 for your board (https://micropython.org/download/) there; the drive goes, a "
            "serial port comes, and ps4rig rig flash finds it"
        )
    boot_out = folder / _CIRCUIT_PYTHON
    if boot_out.exists():
        raise InputError(
            f"{folder} is a board with CircuitPython, which lacks what the firmware needs. Hold "
            "its BOOTSEL button while you plug it in, and copy MicroPython's UF2 for your board "
            "(https://micropython.org/download/) to the drive that appears"
        )


def _is_boards(folder: Path) -> bool:
    marks = (_BOOT_LOADER, _CIRCUIT_PYTHON, "firmware.py", "boot.py")
    try:
        return any((folder / mark).exists() for mark in marks)
    except OSError:
        return False


def _version_in(folder: Path) -> str | None:
    path = folder / "firmware.py"
    return firmware_version(path.read_bytes()) if path.exists() else None


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
