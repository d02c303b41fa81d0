"""The check of ``ps4rig station doctor`` for the systemd unit of a station."""

import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path

from capture.station.domain.folder import StationFolder
from classify.base.errors import InputError
from classify.base.regular_file import read_regular_file
from rig.doctor.check import Check, collected

from .unit import USER, unit_name, unit_text

_NAME = "unit"
_PROPERTIES = "FragmentPath,DropInPaths,UnitFileState,ActiveState,WatchdogUSec,NeedDaemonReload"
_TIMEOUT_S = 10.0
_MAX_BYTES = 1 << 20


def diagnose_unit(folder: Path) -> list[Check]:
    """Check the unit of a station; without one that can be read there is nothing to check."""
    try:
        station = StationFolder(folder, is_foreign=True)
    except InputError:
        return []
    return collected(_NAME, lambda: _check_unit(station))


def _check_unit(station: StationFolder) -> Iterator[Check]:
    """Ask systemd; a machine that does not run it has no such check."""
    if not Path("/run/systemd/system").is_dir():  # as sd_booted(3)
        return
    name = unit_name(station.path)
    command = ("systemctl", "show", f"{name}.service", f"--property={_PROPERTIES}")
    try:
        shown = subprocess.run(
            command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=True
        ).stdout
    except (OSError, subprocess.SubprocessError) as error:
        yield Check(_NAME, "unknown", f"systemctl cannot be asked: {error}")
        return
    properties = dict(line.split("=", 1) for line in shown.splitlines() if "=" in line)
    yield from checks_of_unit(station, properties)


def checks_of_unit(station: StationFolder, properties: Mapping[str, str]) -> Iterator[Check]:
    """Check the unit of a station by the output of ``systemctl show``."""
    name = unit_name(station.path)
    if not properties.get("FragmentPath"):
        text, advice = f"{name} is not installed", _how_to_print(station)
        # From a keyboard only a person can trigger.
        by_hand = station.config.trigger == "enter"
        yield Check(_NAME, "ok" if by_hand else "warning", text, f"for a service: {advice}")
        return
    wrong = [
        Check(_NAME, "warning", f"{name} {text}", advice)
        for text, advice in _faults(station, properties)
    ]
    active, watchdog = properties.get("ActiveState"), properties.get("WatchdogUSec")
    text = f"{name} is installed as printed, enabled, {active}, watchdog {watchdog}"
    yield from wrong or [Check(_NAME, "ok", text)]


def _faults(station: StationFolder, properties: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Faults of an installed unit, each with its remedy."""
    difference = _difference(station, Path(properties["FragmentPath"]))
    if difference is not None:
        yield difference, f"install it again: {_how_to_print(station)}"
    if drop_ins := properties.get("DropInPaths"):
        yield f"is changed by {drop_ins}", "see systemctl cat"
    if properties.get("NeedDaemonReload") == "yes":
        yield "was changed since systemd read it", "run systemctl daemon-reload"
    state = properties.get("UnitFileState")
    if state != "enabled":
        yield f"is {state or 'not enabled'}", "systemctl enable starts it with the machine"
    if properties.get("WatchdogUSec", "0") in ("0", "infinity"):
        yield "has no watchdog", f"set WatchdogSec: {_how_to_print(station)}"


def _how_to_print(station: StationFolder) -> str:
    return f"ps4rig station unit {station.path} prints it"


def _difference(station: StationFolder, path: Path) -> str | None:
    """The first line in which an installed unit differs from the printed one, in words."""
    text = read_regular_file(path, _MAX_BYTES).decode(errors="replace")
    installed = _settings(text)
    users = [line.removeprefix("User=") for line in installed if line.startswith("User=")]
    try:
        panel = False if " --no-panel\n" in text else None  # that of a unit of its own
        expected = _settings(unit_text(station, users[0] if users else USER, panel))
    except InputError as error:
        return f"does not fit the station: {error}"
    missing = next((line for line in expected if line not in installed), None)
    if missing is not None:
        return f"is not as printed: it lacks {missing}"
    more = next((line for line in installed if line not in expected), None)
    return None if more is None else f"is not as printed: it has {more}"


def _settings(text: str) -> list[str]:
    return [line for line in text.splitlines() if line and not line.startswith(("#", ";"))]
