"""Flashing into the folder of a board's drive, and the folders that are refused."""

import subprocess
import sys
from pathlib import Path

import pytest

from classify.errors import InputError
from firmware_sim.firmware import FIRMWARE_VERSION
from rig.errors import LightControllerError
from rig.lights import flash
from rig.lights.discovery import SerialPort
from rig.lights.flash import (
    BoardFile,
    board_files,
    find_board,
    find_drives,
    flash_folder,
    flash_port,
)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_main_is_the_last_file():
    assert [file.name for file in board_files()] == ["firmware.py", "pico_board.py", "main.py"]


def test_a_drive_with_the_firmware_gets_the_new_files(tmp_path):
    (tmp_path / "firmware.py").write_text('FIRMWARE_VERSION = "0.9.1"\n')
    (tmp_path / "notes.txt").write_text("mine")
    assert flash_folder(tmp_path, board_files(), dry_run=True).after == "0.9.1"
    flashed = flash_folder(tmp_path, board_files())
    assert (flashed.before, flashed.after) == ("0.9.1", FIRMWARE_VERSION)
    expected = {file.name: file.data for file in board_files()}
    assert contents(tmp_path) == expected | {"notes.txt": b"mine"}


def test_a_folder_of_something_else_is_only_overwritten_by_force(tmp_path):
    (tmp_path / "main.py").write_text("print('mine')")
    (tmp_path / "firmware.py").write_text("VERSION = 3\n")
    before = contents(tmp_path)
    for dry_run in (True, False):
        with pytest.raises(InputError, match=r"neither holds the firmware nor .*--force"):
            flash_folder(tmp_path, board_files(), drives=[], dry_run=dry_run)
    assert contents(tmp_path) == before
    assert flash_folder(tmp_path, board_files(), drives=[], force=True).after == FIRMWARE_VERSION


def test_the_mounted_drive_of_a_board_needs_no_force(tmp_path):
    (tmp_path / "boot.py").write_text("")
    assert flash_folder(tmp_path, board_files(), drives=[tmp_path]).before is None


def test_files_that_are_read_back_are_compared(tmp_path, monkeypatch):
    (tmp_path / "main.py").write_text("old")
    monkeypatch.setattr(Path, "read_bytes", lambda _: b"something else")
    with pytest.raises(LightControllerError, match="read back"):
        flash_folder(tmp_path, [BoardFile("main.py", tmp_path / "source", b"new")], force=True)
    assert (tmp_path / "main.py").read_text() == "old"


@pytest.mark.parametrize(
    ("mark", "way_out"),
    [("INFO_UF2.TXT", "Copy MicroPython's UF2"), ("boot_out.txt", "Hold its BOOTSEL button")],
)
def test_other_drives_are_refused_with_advice(tmp_path, mark, way_out):
    (tmp_path / mark).write_text("")
    with pytest.raises(InputError, match=way_out):
        flash_folder(tmp_path, board_files(), force=True)
    assert list(contents(tmp_path)) == [mark]


def test_mounted_drives_are_found(tmp_path):
    mounts = tmp_path / "mounts"
    boards, stick = tmp_path / "a board", tmp_path / "stick"
    for folder in (boards, stick):
        folder.mkdir()
    (boards / "INFO_UF2.TXT").write_text("")
    lines = [f"/dev/sdb1 {str(boards).replace(' ', chr(92) + '040')} vfat rw 0 0"]
    lines += [f"/dev/sdc1 {stick} vfat rw 0 0", f"/dev/sda1 {boards} ext4 rw 0 0"]
    mounts.write_text("\n".join(lines))
    assert find_drives(mounts) == [boards]


def test_only_a_pico_with_micropython_is_found():
    pico = SerialPort("/dev/ttyACM0", "2e8a:0005", "e66118604b842a21")
    others = [SerialPort("/dev/ttyUSB0", "0403:6001"), SerialPort("/dev/ttyS0")]
    assert find_board([*others, pico]) == "/dev/ttyACM0"
    with pytest.raises(LightControllerError, match=r"no Raspberry Pi Pico .*ttyUSB0 \(0403:6001\)"):
        find_board(others)
    with pytest.raises(LightControllerError, match="2 boards are plugged in"):
        find_board([pico, pico])


def test_a_missing_mpremote_is_named_with_its_installation(monkeypatch):
    monkeypatch.setattr(flash, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"pip install 'ps4rig\[flash\]'"):
        flash_port("/dev/ttyACM0", board_files())


def test_the_command_reports_in_one_line(tmp_path):
    command = [sys.executable, "-m", "capture", "rig", "flash"]
    done = subprocess.run(
        [*command, "--to", str(tmp_path / "none")], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "no such folder" in done.stderr
    done = subprocess.run(
        [*command, "--to", str(tmp_path), "--force"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0
    assert f"has firmware {FIRMWARE_VERSION}; before: none" in done.stdout
