"""A camera through OpenCV, on image files and a video instead of a device.

tests/hil tests it on a device.
"""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rig import CameraError
from rig.cameras.opencv import OpencvCamera, OpencvCameraConfig

ROWS, COLUMNS, COUNT = 48, 64, 40
BUFFERS = 10


@pytest.fixture(scope="module")
def image_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("images")
    for number in range(COUNT):
        image = np.full((ROWS, COLUMNS, 3), (5 * number, 5 * number, 5 * number), np.uint8)
        cv2.imwrite(str(folder / f"frame{number:03d}.png"), image)
    return folder / "frame%03d.png"


def config(device: Path, **changes: object) -> OpencvCameraConfig:
    values: dict[str, object] = {
        "kind": "opencv",
        "device": str(device),
        "width_px": COLUMNS,
        "height_px": ROWS,
        # OpenCV's rate for image files.
        "frame_rate_hz": 25.0,
        "fixed_exposure": True,
    }
    return OpencvCameraConfig.model_validate(values | changes)


@pytest.fixture
def camera(image_files: Path) -> Iterator[OpencvCamera]:
    opened = OpencvCamera(config(image_files))
    yield opened
    opened.close()


def test_frames_are_grey_and_in_order(camera: OpencvCamera) -> None:
    info = camera.info
    assert (info.kind, info.bit_depth) == ("opencv", 8)
    assert (info.width_px, info.height_px) == (COLUMNS, ROWS)
    for number in range(12):
        frame = camera.read(60.0)
        assert frame.pixels.dtype == np.uint8
        assert (frame.pixels == 5 * number).all()
        assert frame.sequence == number + 1


def test_the_reported_start_is_bounded_by_the_number_of_buffers(camera: OpencvCamera) -> None:
    opened_s = time.monotonic()
    arrived_s = []
    for number in range(BUFFERS + 6):
        time.sleep(0.01)
        frame = camera.read(60.0)
        arrived_s.append(time.monotonic())
        assert frame.exposure_end_s <= time.monotonic()
        earlier = number - BUFFERS - 1
        # One exposure and one period before the arrival of the frame one more than all buffers ago.
        latest_s = (opened_s if earlier < 0 else arrived_s[earlier]) - 0.020 - 1 / 25
        assert frame.exposure_start_s <= latest_s
    assert frame.exposure_start_s > opened_s - 0.061


def test_the_metadata_state_that_there_are_no_time_stamps(camera: OpencvCamera) -> None:
    record = camera.info.controls["opencv"]
    assert "no time stamps" in record["time"]
    assert record["fixed_exposure"]
    assert camera.info.queue_length == BUFFERS + 2


def test_the_end_of_the_images_is_an_error_each_time(camera: OpencvCamera) -> None:
    for _ in range(COUNT):
        camera.read(60.0)
    for _ in range(3):
        with pytest.raises(CameraError, match="no more frames"):
            camera.read(60.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fixed_exposure": False}, r"exposure .*fixed_exposure = true"),
        ({"width_px": 80}, r"80 x 48 px .* 64 x 48"),
        ({"gain": 3}, r"gain was set to 3"),
    ],
)
def test_an_impossible_setting_is_refused(
    image_files: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(CameraError, match=message):
        OpencvCamera(config(image_files, **changes))


class V4l2Video:
    """A `cv2.VideoCapture` of the backend V4L2 that keeps every value and gives grey frames."""

    def __init__(self, *_: object) -> None:
        self.values = {cv2.CAP_PROP_BUFFERSIZE: 4.0, cv2.CAP_PROP_CONTRAST: -1.0}

    def isOpened(self) -> bool:  # noqa: N802 - the name of OpenCV
        return True

    def getBackendName(self) -> str:  # noqa: N802
        return "V4L2"

    def set(self, key: int, value: float) -> bool:
        self.values[key] = value
        return True

    def get(self, key: int) -> float:
        return self.values.get(key, 0.0)

    def read(self) -> tuple[bool, Any]:
        return True, np.zeros((ROWS, COLUMNS), np.uint8)

    def release(self) -> None:
        pass


@pytest.mark.parametrize(("exposure_ms", "set_ms"), [(20.04, 20.0), (0.04, 0.1)])
def test_the_exposure_is_the_one_that_was_set(
    monkeypatch: pytest.MonkeyPatch, exposure_ms: float, set_ms: float
) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", V4l2Video)
    camera = OpencvCamera(config(Path("0"), fixed_exposure=False, exposure_ms=exposure_ms))
    assert camera.info.controls["opencv"]["exposure"] == 10.0 * set_ms
    assert camera.info.exposure_s == pytest.approx(set_ms / 1e3)
    # A control that the camera lacks is not stated.
    assert {"brightness", "iso_speed"} < camera.info.pixel_value_controls.keys()
    assert "contrast" not in camera.info.pixel_value_controls
    camera.close()


def test_a_missing_camera_is_one_error_without_output(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(CameraError, match="OpenCV cannot open it"):
        OpencvCamera(config(tmp_path / "none.avi"))
    assert capfd.readouterr().err == ""


def test_a_video_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "video.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (COLUMNS, ROWS))
    for number in range(5):
        video.write(np.full((ROWS, COLUMNS, 3), 40 * number, np.uint8))
    video.release()
    with pytest.raises(CameraError, match="MJPG, which is lossy"):
        OpencvCamera(config(path))
    camera = OpencvCamera(config(path, allow_compressed=True))
    assert camera.info.controls["opencv"]["compressed"]
    assert [round(float(camera.read(60.0).pixels.mean()) / 40) for _ in range(5)] == [0, 1, 2, 3, 4]
    camera.close()
