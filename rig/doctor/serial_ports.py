"""Checks of serial ports: their list, permissions, and programs that use them."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from rig.lights.discovery import SerialPort
from rig.lights.serial_line import port_holders

from .check import Check

RULES_FILE = Path(__file__).with_name("70-ps4rig.rules")
_RULES_FOLDERS = (Path("/etc/udev/rules.d"), Path("/usr/lib/udev/rules.d"))
_PROC = Path("/proc")
_INSTALL_RULES = (
    f"sudo install -m 644 {RULES_FILE} {_RULES_FOLDERS[0]}/ && "
    "sudo udevadm control --reload && sudo udevadm trigger"
)


def check_ports(ports: Sequence[SerialPort], is_simulated: bool) -> Iterator[Check]:
    """List each serial port; warn if none can be a light controller's."""
    for port in ports:
        holders = ", ".join(map(str, port_holders(port.device)))
        link = port.by_id and f"also {port.by_id}"
        use = f"in use by {holders}" if holders else "not in use"
        kind = "may be a board" if port.may_be_a_microcontroller else "not known as a board"
        parts = (str(port), port.description, link, use, kind)
        yield Check("serial port", "ok", "; ".join(filter(None, parts)))
    if not is_simulated and not any(port.may_be_a_microcontroller for port in ports):
        finding = f"none of {len(ports)} ports belongs to a known board"
        advice = "plug the light controller in; with a charging cable no port appears"
        yield Check("serial ports", "warning", finding, advice)


def check_port(device: str) -> Iterator[Check]:
    """Check that the light controller's port exists, is permitted, and is not in use."""
    if "://" in device:
        yield Check("port", "ok", f"{device} is not a device of this machine")
        return
    if not Path(device).exists():
        advice = 'is the controller plugged in? With lights.port = "auto" it is searched for'
        yield Check("port", "fault", f"{device} does not exist", advice)
        return
    yield check_access("permission", device)
    holders = [holder for holder in port_holders(device) if holder.pid != os.getpid()]
    if holders:
        finding = f"{device} is open in {', '.join(map(str, holders))}"
        yield Check("port in use", "fault", finding, "close that program")
    else:
        yield Check("port in use", "ok", f"no visible program has {device} open")


def check_access(name: str, device: str) -> Check:
    """Check that this user may read and write a device; name a missing group or rule."""
    if os.access(device, os.R_OK | os.W_OK):
        return Check(name, "ok", f"{device} may be read and written")
    status = Path(device).stat()
    try:
        import grp
    except ImportError:  # Windows, whose files have no groups
        return Check(name, "fault", f"{device}: you may not read and write it", "ask for access")
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = str(status.st_gid)
    is_own = status.st_gid in os.getgroups()
    own = "its group is one of yours, but " * is_own
    mode = f"{status.st_mode & 0o777:o}"
    finding = f"{device} belongs to group {group}, mode {mode}; {own}you may not read and write it"
    join = f"sudo usermod -aG {group} $USER and log in again, or " * (not is_own)
    return Check(name, "fault", finding, f"{join}install the udev rules: {_INSTALL_RULES}")


def check_modem_manager(
    proc: Path = _PROC, rules_folders: Sequence[Path] = _RULES_FOLDERS
) -> Check:
    """Check that ModemManager, which talks to every new serial port, leaves boards alone."""
    name = "ModemManager"
    if not any(_is_modem_manager(path) for path in proc.glob("[0-9]*/comm")):
        return Check(name, "ok", "is not running")
    if any((folder / RULES_FILE.name).exists() for folder in rules_folders):
        return Check(name, "ok", f"is running, and {RULES_FILE.name} keeps it away from boards")
    finding = "is running, and treats a board as a modem for some seconds after it is plugged in"
    return Check(name, "warning", finding, _INSTALL_RULES)


def _is_modem_manager(comm: Path) -> bool:
    try:
        return comm.read_text(encoding="utf-8", errors="replace").strip() == "ModemManager"
    except OSError:  # it has just ended
        return False
