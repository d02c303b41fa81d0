"""The check of ``ps4rig station doctor`` for the systemd unit of a station."""

import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path

from capture.station.domain.folder import StationFolder
from classify.base.errors import InputError
from classify.base.regular_file import read_regular_file
from rig.doctor.check import Check, run_checks

from .unit import OPTIONS, USER, unit_name, unit_text

_NAME = "unit"
_PROPERTIES = "FragmentPath,DropInPaths,UnitFileState,ActiveState,WatchdogUSec,NeedDaemonReload"
_TIMEOUT_S = 10.0
_MAX_BYTES = 1 << 20


def diagnose_unit(folder: Path) -> list[Check]:
    """Check the units of a station; without one that can be read there is nothing to check."""
    try:
        station = StationFolder(folder, is_foreign=True)
    except InputError:
        return []
    return run_checks(_NAME, lambda: _check_unit(station))


def _check_unit(station: StationFolder) -> Iterator[Check]:
    """Ask systemd; a machine that does not run it has no such check."""
    if not Path("/run/systemd/system").is_dir():  # as sd_booted(3)
        return
    try:
        run, panel = (
            _properties_of(unit_name(station.path, of_panel)) for of_panel in (False, True)
        )
    except (OSError, subprocess.SubprocessError) as error:
        yield Check(_NAME, "unknown", f"systemctl cannot be asked: {error}")
        return
    yield from checks_of_units(station, run, panel)


def _properties_of(name: str) -> dict[str, str]:
    """The properties of a unit; of one that is not installed most are empty."""
    command = ("systemctl", "show", f"{name}.service", f"--property={_PROPERTIES}")
    listing = subprocess.run(
        command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=True
    ).stdout
    return dict(line.split("=", 1) for line in listing.splitlines() if "=" in line)


def checks_of_units(
    station: StationFolder, run: Mapping[str, str], panel: Mapping[str, str]
) -> Iterator[Check]:
    """Check the units of the run and of the panel by the output of ``systemctl show``."""
    has_panel = True  # of the run
    if run.get("FragmentPath"):
        has_panel = f"{OPTIONS[False]}\n" not in _text(run)
        active, watchdog = run.get("ActiveState"), run.get("WatchdogUSec")
        faults = [*_faults(station, run, None if has_panel else False)]
        if watchdog in (None, "0", "infinity"):
            faults.append(("has no watchdog", f"set WatchdogSec: {_how_to_print(station)}"))
        yield from _checked(station, None, faults, f"{active}, watchdog {watchdog}")
    else:
        # A station that is triggered by the Enter key does not run as a service.
        by_hand = station.config.trigger == "enter"
        text, advice = f"{unit_name(station.path)} is not installed", _how_to_print(station)
        yield Check(_NAME, "ok" if by_hand else "warning", text, f"for a service: {advice}")
    if panel.get("FragmentPath"):
        faults = [*_faults(station, panel, True)]
        if run.get("FragmentPath") and has_panel:
            advice = _how_to_print(station, False)
            faults.append(("serves beside the panel that the run starts", advice))
        yield from _checked(station, True, faults, f"{panel.get('ActiveState')}")
    elif not has_panel:
        text, advice = "is not installed, and the run starts none", _how_to_print(station, True)
        yield from _checked(station, True, [(text, advice)])


def _checked(
    station: StationFolder, panel: bool | None, faults: list[tuple[str, str]], state: str = ""
) -> Iterator[Check]:
    name = unit_name(station.path, panel)
    for text, advice in faults:
        yield Check(_NAME, "warning", f"{name} {text}", advice)
    if not faults:
        yield Check(_NAME, "ok", f"{name} is installed as printed, enabled, {state}")


def _faults(
    station: StationFolder, properties: Mapping[str, str], panel: bool | None
) -> Iterator[tuple[str, str]]:
    """Faults of an installed unit, each with its remedy; `panel` as for `unit_text`."""
    difference = _difference(station, _text(properties), panel)
    if difference is not None:
        yield difference, f"install it again: {_how_to_print(station, panel)}"
    if drop_ins := properties.get("DropInPaths"):
        yield f"is changed by {drop_ins}", "see systemctl cat"
    if properties.get("NeedDaemonReload") == "yes":
        yield "was changed since systemd read it", "run systemctl daemon-reload"
    state = properties.get("UnitFileState")
    if state != "enabled":
        yield f"is {state or 'not enabled'}", "systemctl enable starts it with the machine"


def _how_to_print(station: StationFolder, panel: bool | None = None) -> str:
    return f"ps4rig station unit {station.path}{OPTIONS[panel]} prints it"


def _text(properties: Mapping[str, str]) -> str:
    path = Path(properties["FragmentPath"])
    return read_regular_file(path, _MAX_BYTES).decode(errors="replace")


def _difference(station: StationFolder, text: str, panel: bool | None) -> str | None:
    """The first line in which an installed unit differs from the printed one, in words."""
    installed = _settings(text)
    users = [line.removeprefix("User=") for line in installed if line.startswith("User=")]
    try:
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
