"""A station under a real systemd, installed by the commands that its unit names."""

import json
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.capture.station.production import taught_station
from tests.capture.station.service.systemd_container import SystemdContainer, systemd_container
from tests.capture.station.teaching_sets import SIDE_PX

pytestmark = pytest.mark.systemd

UNIT, PANEL = "ps4rig-line-3.service", "ps4rig-line-3-panel.service"
STATION = Path("/srv/line-3")
PS4RIG = (sys.executable, "-P", "-m", "capture", "station")
AS_OWNER = ("runuser", "-u", "ps4rig", "--")  # a station is for its owner alone
DROP_IN = Path("/etc/systemd/system/ps4rig-line-3.service.d/test.conf")


@pytest.fixture(scope="module")
def systemd(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SystemdContainer]:
    """A systemd with a station that is installed and not started."""
    shared = tmp_path_factory.mktemp("systemd")
    folder = taught_station(shared / "line-3", trigger="timer", timer_s=0.2, rig="rig.toml")
    with (folder / "station.toml").open("a") as config:
        config.write("\n")
    side = f"width_px = {SIDE_PX}\nheight_px = {SIDE_PX}\n"
    (folder / "rig.toml").write_text(f'[lights]\nport = "simulated"\n[camera]\n{side}')
    shutil.rmtree(folder / "shown")
    text = (folder / "station.toml").read_text()
    (folder / "station.toml").write_text(text.replace("port = 8100", "port = 0"))
    with systemd_container(shared) as booted:
        booted.run("cp", "-r", "/mnt/line-3", STATION)
        printed = booted.run(*PS4RIG, "unit", STATION).stdout
        commands = re.findall(r"^#   (.+)$", printed, re.MULTILINE)
        assert len(commands) == 5
        for command in commands[:-1]:
            booted.run("/bin/sh", "-c", command)
        booted.run("/bin/sh", "-c", commands[-1].replace("--now ", ""))
        yield booted


@pytest.fixture
def running(systemd: SystemdContainer) -> Iterator[SystemdContainer]:
    """The station is ready; its parts come by the timer."""
    systemd.run("systemctl", "start", UNIT)
    yield systemd
    systemd.run("systemctl", "stop", UNIT)


def dropped_in(systemd: SystemdContainer, *lines: str) -> None:
    """Change the unit as an administrator does; without lines, as it was."""
    (systemd.shared / "drop-in").write_text("[Service]\n" + "\n".join(lines) + "\n")
    systemd.run("mkdir", "-p", DROP_IN.parent)
    systemd.run("cp", "/mnt/drop-in", DROP_IN)
    if not lines:
        systemd.run("rm", "-r", DROP_IN.parent)
    systemd.run("systemctl", "daemon-reload")


def entries(systemd: SystemdContainer, *matches: str) -> list[dict[str, str]]:
    """Entries of the journal."""
    shown = systemd.run("journalctl", "--unit", UNIT, "--output", "json", *matches).stdout
    return [json.loads(line) for line in shown.splitlines()]


def parts(systemd: SystemdContainer) -> int:
    """Number of announced parts."""
    return len(entries(systemd, "PS4RIG_EVENT=part"))


def test_start_returns_when_the_station_is_ready_and_parts_are_in_the_journal(
    running: SystemdContainer,
) -> None:
    assert running.shown(UNIT, "ActiveState") == "active"
    assert running.shown(UNIT, "StatusText").startswith("ready; parts: ")
    [ready] = entries(running, "PS4RIG_STATE=ready")
    assert ready["MESSAGE"] == "ready: self-test passed"
    running.until(lambda: bool(entries(running, "PS4RIG_PART_ID=part-000002")))
    [part] = entries(running, "PS4RIG_PART_ID=part-000002")
    assert part["PS4RIG_DECISION"] in part["MESSAGE"]
    owner = running.run("stat", "--format=%U", STATION / "results.sqlite").stdout
    assert owner == "ps4rig\n"


def test_the_doctor_finds_the_unit_as_printed(running: SystemdContainer) -> None:
    said = running.run(*PS4RIG, "doctor", STATION, "--json", check=False).stdout
    [unit] = [check for check in json.loads(said)["checks"] if check["name"] == "unit"]
    assert unit["status"] == "ok", unit
    assert "enabled, active, watchdog 1min" in unit["seen"]


def test_run_and_panel_have_a_unit_each(systemd: SystemdContainer) -> None:
    """A killed panel is started again, while the run goes on."""
    units = {UNIT: "--no-panel", PANEL: "--panel"}
    for unit, option in units.items():
        printed = systemd.run(*PS4RIG, "unit", STATION, option).stdout
        commands = re.findall(r"^#   (.+)$", printed, re.MULTILINE)
        for command in commands[2:]:
            systemd.run("/bin/sh", "-c", command)
        systemd.until(lambda unit=unit: systemd.shown(unit, "ActiveState") == "active")
    doctor = systemd.run(*PS4RIG, "doctor", STATION, "--json", check=False).stdout
    checks = [check for check in json.loads(doctor)["checks"] if check["name"] == "unit"]
    assert [check["status"] for check in checks] == ["ok", "ok"], checks

    def served() -> int:
        """How often a panel has begun to serve."""
        return systemd.run("journalctl", "--unit", PANEL).stdout.count("panel: http")

    systemd.until(lambda: served() > 0)
    run, panel, before = *(systemd.shown(unit, "MainPID") for unit in units), served()
    systemd.run("kill", "-KILL", panel)
    systemd.until(lambda: served() > before)
    assert systemd.shown(UNIT, "MainPID") == run
    known = parts(systemd)
    systemd.until(lambda: parts(systemd) > known)
    systemd.run("systemctl", "stop", *units)
    assert [systemd.shown(unit, "Result") for unit in units] == ["success", "success"]
    systemd.run("systemctl", "disable", PANEL)
    systemd.run("rm", f"/etc/systemd/system/{PANEL}")
    printed = systemd.run(*PS4RIG, "unit", STATION).stdout
    for command in re.findall(r"^#   (.+)$", printed, re.MULTILINE)[2:-1]:
        systemd.run("/bin/sh", "-c", command)


def test_a_station_that_hangs_is_killed_by_the_watchdog_and_goes_on(
    systemd: SystemdContainer,
) -> None:
    dropped_in(systemd, "WatchdogSec=8", "RestartSec=100ms")
    systemd.run("systemctl", "start", UNIT)
    before = systemd.shown(UNIT, "MainPID")
    known = parts(systemd)
    systemd.until(lambda: parts(systemd) > known)
    systemd.run("kill", "-STOP", before)
    systemd.until(lambda: int(systemd.shown(UNIT, "NRestarts")) > 0)
    systemd.until(lambda: systemd.shown(UNIT, "ActiveState") == "active")
    assert systemd.shown(UNIT, "MainPID") != before
    told = [entry["MESSAGE"] for entry in entries(systemd)]
    assert any("Watchdog timeout" in line for line in told)
    # Where it hung is in the journal.
    assert any("Fatal Python error: Aborted" in line for line in told)
    known = parts(systemd)
    systemd.until(lambda: parts(systemd) > known)
    systemd.run("systemctl", "stop", UNIT)
    dropped_in(systemd)
    shown = systemd.run(
        *AS_OWNER, *PS4RIG, "history", STATION, "--json", "--include-simulated"
    ).stdout
    numbers = [part["number"] for part in json.loads(shown)["parts"]]
    assert numbers == [*range(1, len(numbers) + 1)]


def test_the_service_cannot_write_or_open_anything_else(systemd: SystemdContainer) -> None:
    systemd.run("chmod", "777", "/srv", "/usr/local")
    forbidden = ("touch /srv/outside", "touch /usr/local/outside", ": < /dev/ttyACM0")
    allowed = (f"touch {STATION}/inside", ": < /dev/urandom")
    script = [f"! ({each}) || echo WRONG {each}" for each in forbidden]
    script += [f"({each}) || echo WRONG {each}" for each in allowed]
    (systemd.shared / "tries.sh").write_text("\n".join(script))
    systemd.run("install", "-m", "644", "/mnt/tries.sh", "/srv/tries.sh")
    dropped_in(systemd, "ExecStartPre=/bin/sh /srv/tries.sh")
    systemd.run("systemctl", "start", UNIT)
    systemd.run("systemctl", "stop", UNIT)
    dropped_in(systemd)
    told = [entry["MESSAGE"] for entry in entries(systemd)]
    assert not [line for line in told if line.startswith("WRONG")]
    assert any("ttyACM0: Operation not permitted" in line for line in told)
    assert any("Read-only file system" in line for line in told)
    systemd.run("test", "-e", STATION / "inside")


def test_an_upgrade_that_does_not_meet_the_challenge_is_not_ready_and_not_repeated(
    systemd: SystemdContainer,
) -> None:
    known = parts(systemd)
    challenge = STATION / "recipes/example/challenge/challenge.toml"
    systemd.run("cp", challenge, "/srv/kept")
    systemd.run("sed", "-i", r"s/PASS/hold/; s/FAIL/PASS/; s/hold/FAIL/", challenge)
    started = systemd.run("systemctl", "start", UNIT, check=False)
    assert started.returncode != 0
    assert systemd.shown(UNIT, "ActiveState") == "failed"
    assert systemd.shown(UNIT, "ExecMainStatus") == "1"
    assert any("must be FAIL and is PASS" in entry["MESSAGE"] for entry in entries(systemd))
    assert parts(systemd) == known
    systemd.run("cp", "/srv/kept", challenge)
    systemd.run("systemctl", "start", UNIT)
    assert systemd.shown(UNIT, "ActiveState") == "active"
    systemd.run("systemctl", "stop", UNIT)
    assert systemd.shown(UNIT, "Result") == "success"


def test_a_backup_of_the_running_service_is_restored_as_the_readme_says(
    running: SystemdContainer,
) -> None:
    running.until(lambda: parts(running) > 0)
    backup, place = "/srv/backup/line-3.ps4backup", STATION.with_name("line-3-before")
    running.run("install", "-d", "-o", "ps4rig", "/srv/backup")
    running.run(*AS_OWNER, *PS4RIG, "backup", STATION, backup)
    running.run("systemctl", "stop", UNIT)
    running.run("mv", STATION, place)
    said = running.run(*PS4RIG, "restore", backup, STATION).stdout
    running.run("chown", "-R", "ps4rig:", STATION)
    [restored] = map(int, re.findall(r"(\d+) parts", said))
    running.run("systemctl", "start", UNIT)
    known = parts(running)
    running.until(lambda: parts(running) > known)
    running.run("systemctl", "stop", UNIT)
    shown = running.run(
        *AS_OWNER, *PS4RIG, "history", STATION, "--json", "--include-simulated"
    ).stdout
    numbers = [part["number"] for part in json.loads(shown)["parts"]]
    assert numbers == [*range(1, len(numbers) + 1)]
    assert len(numbers) > restored > 0
    verified = running.run(*AS_OWNER, *PS4RIG[:-1], "verify", STATION, check=False).stdout
    assert "altered" not in verified
    assert "missing" not in verified
