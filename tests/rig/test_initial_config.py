"""The rig.toml that `ps4rig rig init` writes: it can be loaded, or says what to fill in."""

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rig import ConfigError, ListedCamera, load_config
from rig.cameras.v4l2.measurement_mode import V4l2CameraConfig
from rig.initial_config import answering_controllers, initial_config
from rig.lights.discovery import SerialPort, find_controller

CAMERA = ListedCamera(
    "v4l2",
    "/dev/v4l/by-id/cam",
    "HD camera",
    "uvcvideo",
    formats=("MJPG 1920x1080", "YUYV 640x480 1280x720 1920x1080"),
    config_lines=('pixel_format = "YUYV"', "width_px = 1280", "height_px = 720"),
)


def written(folder: Path, text: str) -> Path:
    (folder / "rig.toml").write_text(text)
    return folder / "rig.toml"


def test_what_is_plugged_in_is_a_valid_configuration(bench: Any, tmp_path: Path) -> None:
    port = SerialPort(bench.port, "2e8a:0005", "E661")
    silent = SerialPort("/dev/ttyNONE", "2e8a:0005")
    controllers = answering_controllers([silent, port])
    assert [who.serial_number for _, who in controllers] == ["SIM-0001"]
    text = initial_config(controllers, [CAMERA])
    config = load_config(written(tmp_path, text))
    assert find_controller(config.lights, [port]) == bench.port
    camera = config.camera
    assert isinstance(camera, V4l2CameraConfig)
    assert (camera.device, camera.pixel_format) == ("/dev/v4l/by-id/cam", "YUYV")
    assert (camera.width_px, camera.height_px) == (1280, 720)
    assert "light controller SIM-0001 (LED4" in text
    assert "#   YUYV 640x480 1280x720 1920x1080" in text


def test_one_of_several_controllers_is_chosen_by_its_serial_number(bench: Any) -> None:
    port = SerialPort(bench.port, "2e8a:0005")
    text = initial_config(answering_controllers([port]) * 2, [CAMERA])
    assert 'serial_number = "SIM-0001"' in text


def test_control_characters_of_devices_stay_in_comments() -> None:
    forged = "x\nframe_rate_hz = 1\r\x01"
    cameras = [
        replace(CAMERA, name=forged),
        ListedCamera("genicam", "y", problem=forged),
    ]
    values = tomllib.loads(initial_config([], cameras))
    assert values["camera"]["frame_rate_hz"] == 30


def test_without_devices_the_file_says_how_to_fill_it_in(tmp_path: Path) -> None:
    path = written(tmp_path, initial_config([], [ListedCamera("v4l2", "v", problem="v: busy")]))
    assert "used: v: busy" in path.read_text()
    with pytest.raises(ConfigError, match=r"lights\.port is missing"):
        load_config(path)
    filled = path.read_text().replace("# port =", "port =")
    with pytest.raises(ConfigError, match=r"camera\.device is missing"):
        load_config(written(tmp_path, filled))
    load_config(written(tmp_path, filled.replace("# device =", "device =")))
