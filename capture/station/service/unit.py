"""The systemd unit of a station, with the commands that install it, and its check."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path

from capture.station.domain.config import StationConfig
from capture.station.domain.folder import StationFolder
from classify.base.errors import InputError
from classify.base.regular_file import read_regular_file
from rig import RigConfig
from rig.cameras.kinds import CAMERA_KINDS
from rig.config.lights import AUTO
from rig.doctor.check import Check, run_checks

_USER = "ps4rig"
_UNITS = "/etc/systemd/system"
# Longest time between two reports of a worker, without its exposures: a database that does not
# answer is abandoned after at most 40 s, and some cameras take 10 s to open.
_TIMEOUT_S = 60.0
# Number of frame periods of a self-test for each image: three tests, two attempts, three frames.
_PERIODS = 18
# Drivers of serial adapters and of boards with USB: /proc/devices.
_SERIAL = ("ttyACM", "ttyUSB")
_FIRST_FREE_PORT = 1024
_HOMES = ("/home", "/root", "/run/user")
_TEMPORARY = ("/tmp", "/var/tmp")

# Not here: MemoryDenyWriteExecute, which forbids numba to compile; PrivateDevices, which hides the
# rig; ProcSubset, which hides the number of processors from the libraries.
_HARDENING = """\
NoNewPrivileges=yes
PrivateMounts=yes
ProtectSystem=strict
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
ProtectProc=invisible
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
LockPersonality=yes
RemoveIPC=yes
KeyringMode=private
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged
SystemCallErrorNumber=EPERM
UMask=0027
LimitCORE=0
DevicePolicy=closed"""
_CHECK = "unit"  # name of the checks
_PROPERTIES = "FragmentPath,DropInPaths,UnitFileState,ActiveState,WatchdogUSec,NeedDaemonReload"
_SYSTEMCTL_TIMEOUT_S = 10.0
_MAX_BYTES = 1 << 20


class Unit(StrEnum):
    """A unit of a station; the value is the option of the commands for it."""

    STATION = ""  # the run with its panel
    RUN = " --no-panel"  # the run without a panel
    PANEL = " --panel"  # the panel alone


def unit_name(folder: Path, unit: Unit = Unit.STATION) -> str:
    """Return the name of a unit, without ``.service``; a run has one name with and without panel.

    It is made from the folder, because a copy of a station has the same name.
    """
    name = "ps4rig-" + re.sub(r"[^A-Za-z0-9:_.-]", "_", folder.resolve().name)
    return f"{name}-panel" if unit is Unit.PANEL else name


def unit_text(station: StationFolder, user: str = _USER, unit: Unit = Unit.STATION) -> str:
    """Return the text of a unit."""
    config, folder = station.config, station.path.resolve()
    if not re.fullmatch(r"[a-z_][a-z0-9_-]{0,30}", user):
        raise InputError(f"--user {user!r}: give the name of a user in lower case")
    is_panel = unit is Unit.PANEL
    service, devices = _panel_service(station) if is_panel else _run_service(station, unit)
    lines = [
        *(f"# {line}".rstrip() for line in _how_to_install(folder, user, unit)),
        *service,
        f"User={user}",
        "# After SIGTERM.",
        "SuccessExitStatus=130",
        "# 256 connections of the panel and 16 of the PLC leave most of them for judging.",
        "LimitNOFILE=4096",
        "CacheDirectory=ps4rig",
        "StateDirectory=ps4rig",
        "Environment=NUMBA_CACHE_DIR=%C/ps4rig XDG_STATE_HOME=%S PYTHONFAULTHANDLER=1",
        "",
        _HARDENING,
        *(f"DeviceAllow={device} rw" for device in devices),
        f"ProtectHome={'read-only' if _lies_in(folder, _HOMES) else 'yes'}",
        f"PrivateTmp={'no' if _lies_in(folder, _TEMPORARY) else 'yes'}",
        *(f"ReadWritePaths={_path(path)}" for path in _writable(station)),
        *_capabilities(config),
        "",
        "[Install]",
        "WantedBy=multi-user.target",
    ]
    return "\n".join(lines) + "\n"


def _run_service(station: StationFolder, unit: Unit) -> tuple[list[str], list[str]]:
    """Return the lines of the run, and its devices."""
    config, folder, rig = station.config, station.path.resolve(), station.rig_config()
    if config.trigger == "enter":
        raise InputError(
            f"{folder}: a service has no keyboard; set trigger = 'timer', 'sensor', 'http' or "
            "'modbus' in station.toml"
        )
    devices, groups = _devices(rig)
    return [
        "[Unit]",
        f"Description=ps4rig station {config.name}{', simulated' * rig.is_simulated}",
        "Wants=network-online.target",
        "After=network-online.target time-sync.target",
        "# A rig may be plugged in days later.",
        "StartLimitIntervalSec=0",
        "",
        "[Service]",
        "Type=notify",
        "NotifyAccess=main",
        f"ExecStart={_program()} station run {_word(folder)}{unit}",
        *([f"SupplementaryGroups={' '.join(groups)}"] if groups else []),
        "# The challenge set is replayed before the station is ready.",
        "TimeoutStartSec=30min",
        "# Pinged by the threads that capture and judge.",
        f"WatchdogSec={_watchdog_s(rig)}",
        "# The run ends its panel itself.",
        "KillMode=mixed",
        "TimeoutStopSec=60",
        "Restart=on-failure",
        "RestartSec=5",
        "# 1: the challenge set was not met; 2: something must be configured.",
        "RestartPreventExitStatus=1 2",
    ], devices


def _panel_service(station: StationFolder) -> tuple[list[str], list[str]]:
    """Return the lines of the panel, which needs no device."""
    return [
        "[Unit]",
        f"Description=panel of ps4rig station {station.config.name}",
        "Wants=network-online.target",
        "After=network-online.target",
        "StartLimitIntervalSec=0",
        "",
        "[Service]",
        f"ExecStart={_program()} station panel {_word(station.path.resolve())}",
        "Restart=on-failure",
        "RestartSec=1",
        "# 2: something must be configured.",
        "RestartPreventExitStatus=2",
    ], []


def _how_to_install(folder: Path, user: str, unit: Unit) -> list[str]:
    name = unit_name(folder, unit)
    program = shlex.join([sys.executable, "-P", "-m", "capture"])
    place = shlex.quote(str(folder))
    return [
        f"Printed by ps4rig station unit, ps4rig {version('ps4rig')}. To install it, as root:",
        f"  id {user} || useradd --system --no-create-home --shell /usr/sbin/nologin {user}",
        f"  chown -R {user}: {place}",
        f"  {program} station unit {place}{unit} --user {user} > {_UNITS}/{name}.service",
        "  systemctl daemon-reload",
        f"  systemctl enable --now {name}",
    ]


def _program() -> str:
    return " ".join(_word(word) for word in (sys.executable, "-P", "-m", "capture"))


def _word(value: object) -> str:
    """Quote a word of a command, in which $ begins a substitution."""
    return _path(str(value).replace("$", "$$"))


def _path(value: object) -> str:
    """Quote a path, in which % begins a substitution."""
    text = str(value)
    if any(character < " " for character in text):
        raise InputError(f"{text!r}: such a path cannot stand in a unit")
    for character, escaped in (("\\", "\\\\"), ('"', '\\"'), ("%", "%%")):
        text = text.replace(character, escaped)
    return f'"{text}"' if re.search(r"[^\w/.,:@%$+-]", text) else text


def _watchdog_s(rig: RigConfig) -> int:
    images = len(rig.lights.tilts_deg) + 1
    return round(_TIMEOUT_S + _PERIODS * images / rig.camera.frame_rate_hz)


def _devices(rig: RigConfig) -> tuple[list[str], list[str]]:
    """Devices of the rig by driver, so that one that is plugged in again is allowed; groups."""
    devices: list[str] = []
    groups = []
    port = rig.lights.port
    if port == AUTO or port.startswith("/"):
        named = re.fullmatch(r"/dev/(tty[A-Za-z]+)\d+", os.path.realpath(port))
        devices += [f"char-{kind}" for kind in ([named[1]] if named else _SERIAL)]
        groups.append("dialout")
    kind = CAMERA_KINDS[rig.camera.kind]
    return [*devices, *kind.device_classes], [*groups, *kind.groups]


def _lies_in(folder: Path, hidden: tuple[str, ...]) -> bool:
    """Whether the station or this program lies in folders that a unit would hide."""
    used = (folder, Path(sys.prefix), Path(sys.base_prefix), Path(__file__))
    return any(path.resolve().is_relative_to(home) for path in used for home in hidden)


def _writable(station: StationFolder) -> list[Path]:
    """The station, and the folder of an SQLite file elsewhere."""
    folder, results = station.path.resolve(), station.results
    home = folder if "://" in results else Path(results).resolve().parent
    return [folder] if home.is_relative_to(folder) else [folder, home]


def _capabilities(config: StationConfig) -> list[str]:
    ports = (config.panel.port, 0 if config.modbus is None else config.modbus.port)
    if not any(0 < port < _FIRST_FREE_PORT for port in ports):
        return ["CapabilityBoundingSet="]
    capability = "CAP_NET_BIND_SERVICE"
    return [f"CapabilityBoundingSet={capability}", f"AmbientCapabilities={capability}"]


def diagnose_unit(folder: Path) -> list[Check]:
    """Check the units of a station; an unreadable station has none to check."""
    try:
        station = StationFolder(folder, is_foreign=True)
    except InputError:
        return []
    return run_checks(_CHECK, lambda: _check_unit(station))


def _check_unit(station: StationFolder) -> Iterator[Check]:
    """Ask systemd; a machine that does not run it has no such check."""
    if not Path("/run/systemd/system").is_dir():  # as sd_booted(3)
        return
    try:
        run, panel = (
            _properties_of(unit_name(station.path, unit)) for unit in (Unit.STATION, Unit.PANEL)
        )
    except (OSError, subprocess.SubprocessError) as error:
        yield Check(_CHECK, "unknown", f"systemctl cannot be asked: {error}")
        return
    yield from checks_of_units(station, run, panel)


def _properties_of(name: str) -> dict[str, str]:
    """The properties of a unit; of one that is not installed most are empty."""
    command = ("systemctl", "show", f"{name}.service", f"--property={_PROPERTIES}")
    listing = subprocess.run(
        command, capture_output=True, text=True, timeout=_SYSTEMCTL_TIMEOUT_S, check=True
    ).stdout
    return dict(line.split("=", 1) for line in listing.splitlines() if "=" in line)


def checks_of_units(
    station: StationFolder, run: Mapping[str, str], panel: Mapping[str, str]
) -> Iterator[Check]:
    """Check the units of the run and of the panel by the output of ``systemctl show``."""
    has_panel = True  # of the run
    if run.get("FragmentPath"):
        has_panel = f"{Unit.RUN}\n" not in _text(run)
        active, watchdog = run.get("ActiveState"), run.get("WatchdogUSec")
        faults = [*_faults(station, run, Unit.STATION if has_panel else Unit.RUN)]
        if watchdog in (None, "0", "infinity"):
            faults.append(("has no watchdog", f"set WatchdogSec: {_how_to_print(station)}"))
        yield from _checked(station, Unit.STATION, faults, f"{active}, watchdog {watchdog}")
    else:
        # A station that is triggered by the Enter key does not run as a service.
        by_hand = station.config.trigger == "enter"
        text, advice = f"{unit_name(station.path)} is not installed", _how_to_print(station)
        yield Check(_CHECK, "ok" if by_hand else "warning", text, f"for a service: {advice}")
    if panel.get("FragmentPath"):
        faults = [*_faults(station, panel, Unit.PANEL)]
        if run.get("FragmentPath") and has_panel:
            advice = _how_to_print(station, Unit.RUN)
            faults.append(("serves beside the panel that the run starts", advice))
        yield from _checked(station, Unit.PANEL, faults, f"{panel.get('ActiveState')}")
    elif not has_panel:
        text, advice = (
            "is not installed, and the run starts none",
            _how_to_print(station, Unit.PANEL),
        )
        yield from _checked(station, Unit.PANEL, [(text, advice)])


def _checked(
    station: StationFolder, unit: Unit, faults: list[tuple[str, str]], state: str = ""
) -> Iterator[Check]:
    name = unit_name(station.path, unit)
    for text, advice in faults:
        yield Check(_CHECK, "warning", f"{name} {text}", advice)
    if not faults:
        yield Check(_CHECK, "ok", f"{name} is installed as printed, enabled, {state}")


def _faults(
    station: StationFolder, properties: Mapping[str, str], unit: Unit
) -> Iterator[tuple[str, str]]:
    """Faults of an installed unit, each with its remedy."""
    difference = _difference(station, _text(properties), unit)
    if difference is not None:
        yield difference, f"install it again: {_how_to_print(station, unit)}"
    if drop_ins := properties.get("DropInPaths"):
        yield f"is changed by {drop_ins}", "see systemctl cat"
    if properties.get("NeedDaemonReload") == "yes":
        yield "was changed since systemd read it", "run systemctl daemon-reload"
    state = properties.get("UnitFileState")
    if state != "enabled":
        yield f"is {state or 'not enabled'}", "systemctl enable starts it with the machine"


def _how_to_print(station: StationFolder, unit: Unit = Unit.STATION) -> str:
    return f"ps4rig station unit {station.path}{unit} prints it"


def _text(properties: Mapping[str, str]) -> str:
    path = Path(properties["FragmentPath"])
    return read_regular_file(path, _MAX_BYTES).decode(errors="replace")


def _difference(station: StationFolder, text: str, unit: Unit) -> str | None:
    """The first line in which an installed unit differs from the printed one, in words."""
    installed = _settings(text)
    users = [line.removeprefix("User=") for line in installed if line.startswith("User=")]
    try:
        expected = _settings(unit_text(station, users[0] if users else _USER, unit))
    except InputError as error:
        return f"does not fit the station: {error}"
    missing = next((line for line in expected if line not in installed), None)
    if missing is not None:
        return f"is not as printed: it lacks {missing}"
    more = next((line for line in installed if line not in expected), None)
    return None if more is None else f"is not as printed: it has {more}"


def _settings(text: str) -> list[str]:
    return [line for line in text.splitlines() if line and not line.startswith(("#", ";"))]
