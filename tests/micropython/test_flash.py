"""`ps4rig rig flash` copies the firmware to real MicroPython with the real mpremote."""

import json
import subprocess
import sys

import pytest
import serial

from firmware_sim.firmware import FIRMWARE_VERSION
from rig.errors import LightControllerError
from rig.lights.flash import board_files, flash_port
from rig.lights.link import ControllerLink

from .conftest import BOARD_FILES

pytestmark = pytest.mark.micropython

NAMES = {"firmware.py", "main.py", "pico_board.py"}


def ps4rig(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "capture", "rig", "flash", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def files_on(pico) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in pico.flash.iterdir()}


def expected_files() -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in board_files()}


def test_an_empty_board_becomes_a_light_controller(new_pico):
    pico = new_pico()
    done = ps4rig("--port", pico.port, "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert (report["before"], report["after"]) == (None, FIRMWARE_VERSION)
    assert files_on(pico) == expected_files()


def test_a_running_controller_is_updated(new_pico, tmp_path):
    old = tmp_path / "firmware.py"
    source = BOARD_FILES[0].read_text().replace(f'"{FIRMWARE_VERSION}"', '"1.9.0"')
    old.write_text(source.replace("PROTOCOL_VERSION = 2", "PROTOCOL_VERSION = 1"))
    pico = new_pico(*BOARD_FILES, old)
    pico.wait_for("watchdog")
    planned = ps4rig("--port", pico.port, "--dry-run")
    assert "would get firmware " + FIRMWARE_VERSION in planned.stdout
    assert "before: 1.9.0" in planned.stdout
    assert files_on(pico)["firmware.py"] == old.read_bytes()
    done = ps4rig("--port", pico.port)
    assert done.returncode == 0, done.stderr
    assert f"has firmware {FIRMWARE_VERSION}; before: 1.9.0" in done.stdout
    assert files_on(pico) == expected_files()


def test_an_interrupted_copy_leaves_the_old_program_running(pico, tmp_path):
    pico.wait_for("watchdog")
    before = files_on(pico)
    with pytest.raises(LightControllerError, match="or it refused"):
        flash_port(pico.port, (*board_files()[:2], tmp_path / "main.py"))
    left = files_on(pico)
    assert {name: left[name] for name in NAMES} == before
    ControllerLink(pico.port, 115_200).close()


def test_a_board_in_use_is_left_alone(pico):
    pico.wait_for("watchdog")
    with serial.Serial(pico.port, exclusive=True):
        done = ps4rig("--port", pico.port)
    assert done.returncode == 3
    assert "in use by" in done.stderr
    assert len(pico.recorded("reset")) == 0
