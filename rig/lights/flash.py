"""Flash the firmware at MicroPython's prompt.

Files are written beside the old ones, read back, and renamed at the end, `main.py` last. An
interrupted copy leaves the old program or none, and never half of a program.
"""

import hashlib
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
from classify.base.errors import InputError
from firmware_sim.firmware import FIRMWARE_VERSION
from rig.errors import LightControllerError

from .discovery import SerialPort, identify, list_serial_ports_if_possible
from .link import ControllerIdentity, ControllerLink
from .serial_line import port_holders

_Result = TypeVar("_Result")
_PICO_WITH_MICROPYTHON = "2e8a:0005"
_UNFINISHED = ".new"
# Longest time of one step of mpremote; copying all files takes a few seconds.
_STEP_TIMEOUT_S = 60.0
# After a reset the USB port disappears for about a second, and then comes back.
_RESET_S = 1.0
_RESTART_TIMEOUT_S = 15.0
_SHA256 = re.compile(r"^[0-9a-f]{64}$", re.MULTILINE)


@dataclass(frozen=True)
class _FlashResult:
    """The board's port, the version of its firmware before and after, and that of the files."""

    port: str
    before: str | None
    after: str | None
    new: str = FIRMWARE_VERSION


def board_files() -> tuple[Path, ...]:
    """The files for a Raspberry Pi Pico, in the order in which they are renamed."""
    folder = Path(firmware_sim.__file__).parent
    return (folder / "firmware.py", folder / "pico" / "pico_board.py", folder / "pico" / "main.py")


def sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def flash_port(port: str, files: Sequence[Path], *, dry_run: bool = False) -> _FlashResult:
    """Replace the program of the MicroPython board at a serial port by `files`, and start it."""
    if find_spec("mpremote") is None:
        raise InputError("flashing needs mpremote: pip install 'ps4rig[flash]'")
    if holders := port_holders(port):
        raise LightControllerError(f"{port}: in use by {holders[0]}; close that first")
    # The device's number may change when the board resets.
    names = {listed.device: listed.by_id for listed in list_serial_ports_if_possible()}
    port = names.get(port) or port
    running = _running_controller(port, stop=not dry_run)
    before = running.firmware_version if running else None
    if dry_run:
        return _FlashResult(port, before, before)
    time.sleep(_RESET_S)
    _until_ready(lambda: _on_board(port, "exec", "pass"))
    try:
        _write_files(port, files)
    except LightControllerError:
        with suppress(LightControllerError):
            _on_board(port, "reset")  # the old program runs again
        raise
    _on_board(port, "reset")
    time.sleep(_RESET_S)
    return _FlashResult(port, before, _until_ready(lambda: identify(port)).firmware_version)


def find_board(ports: Sequence[SerialPort]) -> str:
    """Return the port of the only Raspberry Pi Pico with MicroPython among `ports`."""
    boards = [port for port in ports if port.usb_id == _PICO_WITH_MICROPYTHON]
    if len(boards) == 1:
        return boards[0].device
    if boards:
        choices = ", ".join(str(board) for board in boards)
        raise LightControllerError(
            f"{len(boards)} boards are plugged in: {choices}; give one as --port"
        )
    listed = ", ".join(str(port) for port in ports) or "there are no serial ports"
    raise LightControllerError(
        f"no Raspberry Pi Pico with MicroPython was found ({listed}). Plug it in; if it shows as a "
        "drive, first copy MicroPython's UF2 for it (https://micropython.org/download/) there. "
        "Another board's port can be given as --port"
    )


def _write_files(port: str, files: Sequence[Path]) -> None:
    _on_board(port, "exec", "import rp2")  # fails on other boards, whose pins differ
    names = [file.name for file in files]
    for file in files:
        _on_board(port, "fs", "cp", "-f", str(file), f":{file.name}{_UNFINISHED}")
    _compare(files, _hashes(port, [name + _UNFINISHED for name in names]))
    renames = [f"os.rename({name + _UNFINISHED!r}, {name!r})" for name in names]
    _on_board(port, "exec", "; ".join(["import os", *renames]))
    _compare(files, _hashes(port, names))


def _hashes(port: str, names: Sequence[str]) -> list[str]:
    return _SHA256.findall(_on_board(port, "fs", "sha256sum", *(f":{name}" for name in names)))


def _compare(files: Sequence[Path], read_back: Sequence[str]) -> None:
    expected = [sha256(file) for file in files]
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


def _until_ready(attempt: Callable[[], _Result]) -> _Result:
    """Repeat `attempt` until it succeeds or a board would have restarted."""
    deadline_s = time.monotonic() + _RESTART_TIMEOUT_S
    while True:
        try:
            return attempt()
        except LightControllerError:
            if time.monotonic() > deadline_s:
                raise
        time.sleep(0.2)


def _on_board(port: str, *arguments: str) -> str:
    """Run a command of mpremote at MicroPython's prompt; return its output."""
    command = [sys.executable, "-m", "mpremote", "connect", port, "resume", *arguments]
    try:
        result = subprocess.run(
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
    if result.returncode != 0:
        lines = (result.stdout + result.stderr).strip().splitlines()
        raise LightControllerError(
            f"{port}: no MicroPython for a Raspberry Pi Pico answers, or it refused: "
            f"{lines[-1] if lines else 'mpremote failed'}"
        )
    return result.stdout
