"""Cameras are listed by node; tests/hil lists the kernel's test driver."""

from pathlib import Path

import pytest

from rig.cameras.v4l2.camera import config_lines, list_v4l2_cameras
from rig.cameras.v4l2.device import OfferedFormat, device_path
from rig.cameras.v4l2.measurement_mode import V4l2CameraConfig


@pytest.mark.parametrize(
    ("device", "path"),
    [
        ("/dev/video3", "/dev/video3"),
        ("./camera", "./camera"),
        (3, "/dev/video3"),
        ("12", "/dev/video12"),
        ("usb-Maker_Cam_01-video-index0", "/dev/v4l/by-id/usb-Maker_Cam_01-video-index0"),
    ],
)
def test_a_device_is_a_path_a_number_or_a_name(device: str | int, path: str) -> None:
    config = V4l2CameraConfig.model_validate({"kind": "v4l2", "device": device})
    assert config.device is not None
    assert device_path(config.device) == path


def test_nodes_are_in_order_and_an_unusable_one_has_its_problem(tmp_path: Path) -> None:
    for name in ("video10", "video2", "videodev", "vbi0"):
        (tmp_path / name).touch()
    by_id = tmp_path / "v4l" / "by-id"
    by_id.mkdir(parents=True)
    (by_id / "usb-Maker_Cam_01-video-index0").symlink_to("../../video10")
    (by_id / "usb-Gone_Cam-video-index0").symlink_to("../../video7")
    second, tenth = list_v4l2_cameras(tmp_path)
    assert (second.node, tenth.node) == (tmp_path / "video2", tmp_path / "video10")
    assert second.device == str(tmp_path / "video2")
    assert tenth.device == str(by_id / "usb-Maker_Cam_01-video-index0")
    for camera in (second, tenth):
        assert camera.problem is not None
        assert camera.problem.startswith(f"{camera.node}: is no video device")
        assert camera.formats == camera.config_lines == ()


def test_without_cameras_the_list_is_empty(tmp_path: Path) -> None:
    assert list_v4l2_cameras(tmp_path) == []


@pytest.mark.parametrize(
    ("fourccs", "chosen"),
    [
        (("YUYV", "GREY"), ['pixel_format = "GREY"']),
        (("RGGB", "Y12 ", "Y10 "), ['pixel_format = "Y12"']),
        (("MJPG",), ['pixel_format = "MJPG"', "allow_compressed = true"]),
        (("H264",), []),
    ],
)
def test_the_best_pixel_format_is_chosen(fourccs: tuple[str, ...], chosen: list[str]) -> None:
    lines = config_lines(OfferedFormat(fourcc, "", ("640x480",)) for fourcc in fourccs)
    assert [line.split("  ")[0] for line in lines if "px" not in line] == chosen


def test_the_largest_size_that_usb_carries_is_chosen() -> None:
    sizes = ("640x480", "1280x720", "1920x1080")
    lines = config_lines([OfferedFormat("YUYV", "YUYV 4:2:2", sizes)])
    assert lines[1:] == ("width_px = 1280", "height_px = 720")
