"""The systemd unit of a station: read by systemd itself, and checked by the doctor."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.folder import StationFolder, make_station
from capture.station.service.unit import Unit, checks_of_units, unit_name, unit_text
from classify.base.errors import InputError

# systemd 252 gives 2.0; a service without options has 9.6.
MOST_EXPOSURE = 2.2
# What systemctl shows of a unit that is not installed.
NONE = {"FragmentPath": "", "UnitFileState": ""}


def changed(folder: Path, **keys: str) -> StationFolder:
    """The station with other values in its configuration."""
    text = (folder / "station.toml").read_text()
    for key, value in keys.items():
        text = re.sub(rf"(?m)^{key} = .*$", lambda _, k=key, v=value: f"{k} = {v}", text)
    (folder / "station.toml").write_text(text)
    return StationFolder(folder)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "line-3"
    make_station(folder)
    changed(folder, trigger='"timer"')
    return folder


@pytest.fixture
def station(folder: Path) -> StationFolder:
    return StationFolder(folder)


def settings(text: str) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        if "=" in line and not line.startswith("#"):
            name, value = line.split("=", 1)
            found.setdefault(name, []).append(value)
    return found


def with_rig(folder: Path, lights: str, camera: str) -> StationFolder:
    (folder / "rig.toml").write_text(f"[lights]\n{lights}\n[camera]\n{camera}\n")
    return changed(folder, rig='"rig.toml"')


def test_the_unit_runs_this_station_with_this_program(ps4rig: Any, folder: Path) -> None:
    printed = ps4rig("station", "unit", folder)
    assert printed.exit_code == 0
    found = settings(printed.stdout)
    assert found["ExecStart"][0].endswith(f"-P -m capture station run {folder.resolve()}")
    assert found["Type"] == ["notify"]
    assert found["ReadWritePaths"] == [str(folder.resolve())]
    assert found["User"] == ["ps4rig"]
    assert "simulated" in found["Description"][0]
    assert found["LimitNOFILE"] == ["4096"]
    assert "DeviceAllow" not in found
    assert "systemctl enable --now ps4rig-line-3" in printed.stdout


def test_the_panel_can_have_a_unit_of_its_own(ps4rig: Any, folder: Path) -> None:
    alone = ps4rig("station", "unit", folder, "--panel").stdout
    found = settings(alone)
    assert found["ExecStart"][0].endswith(f"-P -m capture station panel {folder.resolve()}")
    assert found["ReadWritePaths"] == [str(folder.resolve())]
    assert "Type" not in found
    assert f"unit {folder.resolve()} --panel --user ps4rig > " in alone
    assert "systemctl enable --now ps4rig-line-3-panel" in alone
    without = settings(ps4rig("station", "unit", folder, "--no-panel").stdout)
    assert without["ExecStart"][0].endswith(f"station run {folder.resolve()} --no-panel")


def test_a_keyboard_is_no_trigger_of_a_service(ps4rig: Any, folder: Path) -> None:
    changed(folder, trigger='"enter"')
    refused = ps4rig("station", "unit", folder)
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert "a service has no keyboard; set trigger = 'timer'" in refused.stderr


@pytest.mark.parametrize(
    ("port", "devices"),
    [
        ("auto", ["char-ttyACM rw", "char-ttyUSB rw"]),
        ("/dev/ttyACM7", ["char-ttyACM rw"]),
        ("/dev/serial/by-id/usb-Pico", ["char-ttyACM rw", "char-ttyUSB rw"]),
        ("socket://rig:4000", []),
    ],
)
def test_the_devices_of_the_rig_are_allowed_and_no_others(
    folder: Path, port: str, devices: list[str]
) -> None:
    station = with_rig(folder, f'port = "{port}"', 'device = "/dev/video0"')
    found = settings(unit_text(station))
    assert found["DeviceAllow"] == [*devices, "char-video4linux rw"]
    assert found["DevicePolicy"] == ["closed"]
    assert found["SupplementaryGroups"] == ["dialout video" if devices else "video"]


def test_the_watchdog_waits_for_long_exposures(station: StationFolder, folder: Path) -> None:
    quick = int(settings(unit_text(station))["WatchdogSec"][0])
    slow = with_rig(
        folder,
        'port = "simulated"\nwatchdog_ms = 60000',
        "frame_rate_hz = 0.1\nexposure_ms = 9000\nreadout_ms = 1",
    )
    assert quick < 100
    # Three self-tests of five images, of three frames of 10 s each, twice.
    assert int(settings(unit_text(slow))["WatchdogSec"][0]) >= 3 * 5 * 3 * 10 * 2


def test_results_in_another_folder_can_be_written(folder: Path, tmp_path: Path) -> None:
    station = changed(folder, results=f'"{tmp_path}/db/results.sqlite"')
    assert settings(unit_text(station))["ReadWritePaths"] == [str(folder), f"{tmp_path}/db"]


def test_a_low_port_needs_one_capability(folder: Path) -> None:
    assert settings(unit_text(StationFolder(folder)))["CapabilityBoundingSet"] == [""]
    found = settings(unit_text(changed(folder, port="443")))
    assert found["AmbientCapabilities"] == ["CAP_NET_BIND_SERVICE"]


@pytest.mark.parametrize("user", ["Ada", "a b", "x\nExecStart=/bin/sh", ""])
def test_a_name_that_is_no_user_is_refused(station: StationFolder, user: str) -> None:
    with pytest.raises(InputError, match="--user"):
        unit_text(station, user)


@pytest.mark.systemd
@pytest.mark.parametrize("unit", [Unit.STATION, Unit.PANEL])
@pytest.mark.parametrize("name", ["line-3", 'odd name $HOME 50% "it\'s" \\x'])
def test_systemd_reads_the_unit_without_complaint(tmp_path: Path, name: str, unit: Unit) -> None:
    folder = tmp_path / name
    make_station(tmp_path / "line-3")
    (tmp_path / "line-3").rename(folder)
    path = tmp_path / "ps4rig-line-3.service"
    # The user of a unit must exist for systemd to verify it.
    path.write_text(unit_text(changed(folder, trigger='"http"'), "root", unit))
    verified = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(path)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (verified.returncode, verified.stderr) == (0, "")


@pytest.mark.systemd
@pytest.mark.parametrize("unit", [Unit.STATION, Unit.PANEL])
def test_systemd_calls_the_unit_well_shielded(
    station: StationFolder, tmp_path: Path, unit: Unit
) -> None:
    path = tmp_path / "ps4rig-line-3.service"
    path.write_text(unit_text(station, unit=unit))
    rated = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--no-pager", str(path)],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    exposure = re.search(r"Overall exposure level .*: ([0-9.]+)", rated.stdout)
    assert float(exposure[1]) <= MOST_EXPOSURE


def shown(path: Path, **changes: str) -> dict[str, str]:
    """What systemctl shows of an installed unit that runs."""
    return {
        "FragmentPath": str(path),
        "DropInPaths": "",
        "UnitFileState": "enabled",
        "ActiveState": "active",
        "WatchdogUSec": "1min 3s",
        "NeedDaemonReload": "no",
    } | changes


@pytest.fixture
def installed(station: StationFolder, tmp_path: Path) -> Path:
    path = tmp_path / f"{unit_name(station.path)}.service"
    path.write_text(unit_text(station, "kim"))
    return path


def test_a_unit_as_printed_for_any_user_is_good(station: StationFolder, installed: Path) -> None:
    [check] = checks_of_units(station, shown(installed), NONE)
    assert (check.status, check.seen) == (
        "ok",
        "ps4rig-line-3 is installed as printed, enabled, active, watchdog 1min 3s",
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"UnitFileState": "disabled"}, "is disabled"),
        ({"WatchdogUSec": "0"}, "has no watchdog"),
        ({"WatchdogUSec": "infinity"}, "has no watchdog"),
        ({"NeedDaemonReload": "yes"}, "was changed since systemd read it"),
        ({"DropInPaths": "/etc/systemd/system/x.conf"}, "is changed by /etc"),
    ],
)
def test_what_systemd_says_otherwise_is_a_warning(
    station: StationFolder, installed: Path, changes: dict[str, str], said: str
) -> None:
    [check] = checks_of_units(station, shown(installed, **changes), NONE)
    assert check.status == "warning"
    assert said in check.seen


def test_a_unit_of_another_rig_or_program_is_named(
    station: StationFolder, folder: Path, installed: Path
) -> None:
    text = installed.read_text()
    installed.write_text(text.replace("NoNewPrivileges=yes\n", "# NoNewPrivileges=yes\n"))
    [check] = checks_of_units(station, shown(installed), NONE)
    assert check.seen == "ps4rig-line-3 is not as printed: it lacks NoNewPrivileges=yes"
    installed.write_text(text + "DeviceAllow=/dev/mem rw\n")
    [check] = checks_of_units(station, shown(installed), NONE)
    assert check.seen.endswith("it has DeviceAllow=/dev/mem rw")
    installed.write_text(text)
    real = with_rig(folder, 'port = "auto"', 'device = "/dev/video0"')
    [check] = checks_of_units(real, shown(installed), NONE)
    assert "it lacks Description=ps4rig station line-3" in check.seen


@pytest.fixture
def panel_unit(station: StationFolder, tmp_path: Path) -> Path:
    path = tmp_path / f"{unit_name(station.path, Unit.PANEL)}.service"
    path.write_text(unit_text(station, "kim", Unit.PANEL))
    return path


def test_the_unit_of_the_panel_is_checked_like_that_of_the_run(
    station: StationFolder, installed: Path, panel_unit: Path
) -> None:
    installed.write_text(unit_text(station, "kim", Unit.RUN))
    of_panel = shown(panel_unit, WatchdogUSec="0")
    checks = list(checks_of_units(station, shown(installed), of_panel))
    assert [check.status for check in checks] == ["ok", "ok"]
    assert "ps4rig-line-3-panel is installed as printed" in checks[1].seen
    panel_unit.write_text(panel_unit.read_text().replace("UMask=0027\n", ""))
    checks = list(checks_of_units(station, shown(installed), of_panel))
    assert [check.status for check in checks] == ["ok", "warning"]
    assert "ps4rig-line-3-panel is not as printed: it lacks UMask=0027" in checks[1].seen


def test_a_station_has_one_panel(station: StationFolder, installed: Path, panel_unit: Path) -> None:
    checks = list(checks_of_units(station, shown(installed), shown(panel_unit)))
    assert [check.status for check in checks] == ["ok", "warning"]
    assert "beside the panel that the run starts" in checks[1].seen
    installed.write_text(unit_text(station, "kim", Unit.RUN))
    checks = list(checks_of_units(station, shown(installed), NONE))
    assert [check.status for check in checks] == ["ok", "warning"]
    assert "ps4rig-line-3-panel is not installed" in checks[1].seen
    assert " --panel prints it" in checks[1].advice


def test_a_missing_unit_matters_only_without_a_keyboard(folder: Path) -> None:
    [check] = checks_of_units(StationFolder(folder), {}, NONE)
    assert (check.status, check.seen) == ("warning", "ps4rig-line-3 is not installed")
    [check] = checks_of_units(changed(folder, trigger='"enter"'), {}, NONE)
    assert check.status == "ok"


def test_a_copy_of_a_station_has_a_unit_of_its_own(ps4rig: Any, folder: Path) -> None:
    copy = folder.with_name("line 3, restored")
    shutil.copytree(folder, copy)
    assert "ps4rig-line_3__restored.service" in ps4rig("station", "unit", copy).stdout
    assert "ps4rig-line-3.service" in ps4rig("station", "unit", folder).stdout
