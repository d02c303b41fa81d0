"""Flash the firmware: over MicroPython's prompt, or into a board's drive.

Files are written beside the old ones, read back, and renamed at the end, `main.py` last. An
interrupted copy leaves the old program or none, and never half of a program.
"""

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
from classify.durable_file import sync
from classify.errors import InputError
from rig.errors import LightControllerError

from .discovery import SerialPort, identify, list_serial_ports_if_possible
from .link import ControllerIdentity, ControllerLink
from .port_holders import port_holders

T = TypeVar("T")
_PICO_WITH_MICROPYTHON = "2e8a:0005"
_UNFINISHED = ".new"
# Longest time of one step of mpremote; copying all files takes a few seconds.
_STEP_TIMEOUT_S = 60.0
# After a reset the USB port disappears for about a second, and then comes back.
_RESET_S = 1.0
_RESTART_TIMEOUT_S = 15.0
# Files that identify a drive.
_BOOT_LOADER = "INFO_UF2.TXT"
_CIRCUIT_PYTHON = "boot_out.txt"
_SHA256 = re.compile(r"^[0-9a-f]{64}$", re.MULTILINE)
_VERSION = re.compile(rb'^FIRMWARE_VERSION = "([0-9A-Za-z.+-]{1,32})"', re.MULTILINE)


@dataclass(frozen=True)
class BoardFile:
    """A file for the board: its name there, its source here, its bytes."""

    name: str
    path: Path
    data: bytes

    @property
    def sha256(self) -> str:
        """SHA-256 of the bytes, in hexadecimal digits."""
        return hashlib.sha256(self.data).hexdigest()


@dataclass(frozen=True)
class Flashed:
    """The board or folder of the firmware, and its version before and after.

    A version is None without the firmware.
    """

    where: str
    before: str | None
    after: str | None


def board_files() -> tuple[BoardFile, ...]:
    """Return the files for a Raspberry Pi Pico, in the order in which they are renamed."""
    folder = Path(firmware_sim.__file__).parent
    paths = (folder / "firmware.py", folder / "pico" / "pico_board.py", folder / "pico" / "main.py")
    return tuple(BoardFile(path.name, path, path.read_bytes()) for path in paths)


def firmware_version(source: bytes) -> str | None:
    """Return the version in the source of a firmware file, None without one."""
    found = _VERSION.search(source)
    return found[1].decode() if found else None


def flash_folder(
    folder: Path,
    files: Sequence[BoardFile],
    *,
    drives: Sequence[Path] | None = None,
    force: bool = False,
    dry_run: bool = False,
) -> Flashed:
    """Put files into the folder that a MicroPython board shows as its drive.

    The folder must hold the firmware already or be one of `drives` (by default those of
    `find_drives`), unless `force` is set. With `dry_run` all checks run, and nothing is written.
    """
    _refuse_other_drives(folder)
    before = _version_in(folder)
    drives = find_drives() if drives is None else drives
    if before is None and not force and folder.resolve() not in [each.resolve() for each in drives]:
        raise InputError(
            f"{folder} neither holds the firmware nor is the mounted drive of a MicroPython "
            "board; give the board's drive, or --force to replace main.py there"
        )
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
        sync(folder)
    return Flashed(str(folder), before, _version_in(folder))


def flash_port(port: str, files: Sequence[BoardFile], *, dry_run: bool = False) -> Flashed:
    """Put files on the MicroPython board at a serial port, and start them.

    A running light controller is stopped first; any other program is interrupted.
    """
    if find_spec("mpremote") is None:
        raise InputError("flashing over a serial port needs mpremote: pip install 'ps4rig[flash]'")
    if holders := port_holders(port):
        raise LightControllerError(f"{port}: in use by {holders[0]}; close that first")
    # The device's number may change when the board resets.
    listed = list_serial_ports_if_possible()
    port = next((each.by_id or port for each in listed if each.device == port), port)
    running = _running_controller(port, stop=not dry_run)
    before = running.firmware_version if running else None
    if dry_run:
        return Flashed(port, before, before)
    time.sleep(_RESET_S)
    _until_ready(lambda: _on_board(port, "exec", "pass"))
    try:
        _put(port, files)
    except LightControllerError:
        with suppress(LightControllerError):
            _on_board(port, "reset")  # the old program runs again
        raise
    _on_board(port, "reset")
    time.sleep(_RESET_S)
    return Flashed(port, before, _until_ready(lambda: identify(port)).firmware_version)


def find_board(ports: Sequence[SerialPort]) -> str:
    """Return the port of the only Raspberry Pi Pico with MicroPython among `ports`.

    Other boards are never chosen, because flashing interrupts the program that runs there.
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
        f"no Raspberry Pi Pico with MicroPython was found ({found}); is it plugged in, and does "
        "MicroPython run on it? Another board's port can be given as --port"
    )


def find_drives(mounts: Path = Path("/proc/self/mounts")) -> list[Path]:
    """List mounted drives of boards, boot loaders included; empty if mounts are not listed."""
    try:
        lines = mounts.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    fields = [line.split() for line in lines]
    folders = [Path(each[1].replace("\\040", " ")) for each in fields if each[2] == "vfat"]
    return [folder for folder in folders if _is_board_drive(folder)]


def _put(port: str, files: Sequence[BoardFile]) -> None:
    _on_board(port, "exec", "import rp2")  # fails on other boards, whose pins differ
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
            f"the files read back from the board differ from those written ({names}); is its "
            "memory full? Flash it again, or erase it and install MicroPython again"
        )


def _running_controller(port: str, *, stop: bool) -> ControllerIdentity | None:
    """Identify the controller that runs at a port, and `stop` it; None without one."""
    try:
        link = ControllerLink(port, any_protocol=True)
    except LightControllerError:
        return None  # MicroPython's prompt or another program, which mpremote handles
    try:
        if stop and not link.ask("SYST:PROG").ok:
            raise LightControllerError(f"{port}: the controller does not stop its program")
    finally:
        link.close()
    return link.identity


def _until_ready(attempt: Callable[[], T]) -> T:
    """Repeat `attempt` until it succeeds or a board would have restarted."""
    deadline_s = time.monotonic() + _RESTART_TIMEOUT_S
    while True:
        try:
            return attempt()
        except LightControllerError:
            if time.monotonic() > deadline_s:
                raise
        time.sleep(0.2)


def _on_board(port: str, *words: str) -> str:
    """Run a command of mpremote at MicroPython's prompt; return its output."""
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
        lines = (done.stdout + done.stderr).strip().splitlines()
        raise LightControllerError(
            f"{port}: no MicroPython for a Raspberry Pi Pico answers, or it refused: "
            f"{lines[-1] if lines else 'mpremote failed'}"
        )
    return done.stdout


def _refuse_other_drives(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; is the board's drive mounted?")
    if (folder / _BOOT_LOADER).exists():
        raise InputError(
            f"{folder} is a board's boot loader, which takes UF2 files only. Copy MicroPython's "
            "UF2 for your board (https://micropython.org/download/) there; a serial port appears "
            "in place of the drive, and ps4rig rig flash finds it"
        )
    if (folder / _CIRCUIT_PYTHON).exists():
        raise InputError(
            f"{folder} is a board with CircuitPython, on which the firmware does not run. Hold "
            "its BOOTSEL button while you plug it in, and copy MicroPython's UF2 for your board "
            "(https://micropython.org/download/) to the drive that appears"
        )


def _is_board_drive(folder: Path) -> bool:
    marks = (_BOOT_LOADER, _CIRCUIT_PYTHON, "firmware.py", "boot.py")
    try:
        return any((folder / mark).exists() for mark in marks)
    except OSError:
        return False


def _version_in(folder: Path) -> str | None:
    path = folder / "firmware.py"
    return firmware_version(path.read_bytes()) if path.exists() else None
