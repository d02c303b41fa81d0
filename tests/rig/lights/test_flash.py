"""The board that is flashed, and its files."""

import pytest

from classify.base.errors import InputError
from rig.errors import LightControllerError
from rig.lights import flash
from rig.lights.discovery import SerialPort
from rig.lights.flash import board_files, find_board, flash_port


def test_main_is_the_last_file():
    assert [file.name for file in board_files()] == ["firmware.py", "pico_board.py", "main.py"]


def test_only_a_pico_with_micropython_is_found():
    pico = SerialPort("/dev/ttyACM0", "2e8a:0005", "e66118604b842a21")
    others = [SerialPort("/dev/ttyUSB0", "0403:6001"), SerialPort("/dev/ttyS0")]
    assert find_board([*others, pico]) == "/dev/ttyACM0"
    with pytest.raises(LightControllerError, match=r"Raspberry Pi Pico .*\(0403:6001\)"):
        find_board(others)
    with pytest.raises(LightControllerError, match="2 boards are plugged in"):
        find_board([pico, pico])


def test_a_missing_mpremote_is_named_with_its_installation(monkeypatch):
    monkeypatch.setattr(flash, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"pip install 'ps4rig\[flash\]'"):
        flash_port("/dev/ttyACM0", board_files())
