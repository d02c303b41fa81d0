"""A camera through OpenCV: its real code, on pictures and a film instead of a device.

On a device it is tested in tests/hil.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from rig import CameraError
from rig.config.camera import OpencvCameraConfig
from rig.opencv_camera import OpencvCamera

ROWS, COLUMNS, COUNT = 48, 64, 40
BUFFERS = 10


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    for number in range(COUNT):
        picture = np.full((ROWS, COLUMNS, 3), (5 * number, 5 * number, 5 * number), np.uint8)
        cv2.imwrite(str(folder / f"frame{number:03d}.png"), picture)
    return folder / "frame%03d.png"


def config(device: Path, **changes: object) -> OpencvCameraConfig:
    values: dict[str, object] = {
        "kind": "opencv",
        "device": str(device),
        "width_px": COLUMNS,
        "height_px": ROWS,
        # What OpenCV says of pictures.
        "frame_rate_hz": 25.0,
        "fixed_exposure": True,
    }
    return OpencvCameraConfig.model_validate(values | changes)


@pytest.fixture
def camera(pictures: Path) -> Iterator[OpencvCamera]:
    opened = OpencvCamera(config(pictures))
    yield opened
    opened.close()


def test_frames_are_grey_and_in_order(camera: OpencvCamera) -> None:
    info = camera.info
    assert (info.kind, info.width_px, info.height_px, info.bit_depth) == (
        "opencv",
        COLUMNS,
        ROWS,
        8,
    )
    for number in range(12):
        frame = camera.read(2.0)
        assert frame.pixels.dtype == np.uint8
        assert (frame.pixels == 5 * number).all()
        assert frame.sequence == number + 1


def test_a_frame_is_believed_to_be_as_old_as_it_may_be(camera: OpencvCamera) -> None:
    opened_s = time.monotonic()
    came_s = []
    for number in range(BUFFERS + 6):
        time.sleep(0.01)
        frame = camera.read(2.0)
        came_s.append(time.monotonic())
        assert frame.exposure_end_s <= time.monotonic()
        earlier = number - BUFFERS - 1
        # One exposure and one period before the frame came that all buffers separate from it.
        latest_s = (opened_s if earlier < 0 else came_s[earlier]) - 0.020 - 1 / 25
        assert frame.exposure_start_s <= latest_s
    assert frame.exposure_start_s > opened_s - 0.061


def test_its_metadata_say_how_little_is_known(camera: OpencvCamera) -> None:
    record = camera.info.controls["opencv"]
    assert "no time stamps" in record["time"]
    assert record["fixed_exposure"]
    assert camera.info.queue_length == BUFFERS + 2


def test_the_end_of_the_pictures_is_an_error_and_stays_one(camera: OpencvCamera) -> None:
    for _ in range(COUNT):
        camera.read(2.0)
    for _ in range(3):
        with pytest.raises(CameraError, match="gives no more frames"):
            camera.read(2.0)


def test_close_may_be_called_again_and_ends_the_frames(camera: OpencvCamera) -> None:
    camera.read(2.0)
    camera.close()
    camera.close()
    with pytest.raises(CameraError, match="is closed"):
        camera.read(2.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fixed_exposure": False}, r"automatic exposure off is not known.*fixed_exposure = true"),
        ({"width_px": 80}, r"80 x 48 px were asked for, OpenCV gives 64 x 48"),
        ({"gain": 3}, r"gain was set to 3 through OpenCV and reads"),
    ],
)
def test_what_it_cannot_do_is_refused(
    pictures: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(CameraError, match=message):
        OpencvCamera(config(pictures, **changes))


def test_a_camera_that_is_not_there_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(CameraError, match="OpenCV cannot open it"):
        OpencvCamera(config(tmp_path / "none.avi"))
    assert capfd.readouterr().err == ""


def test_a_film_is_read_through_the_same_class(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (COLUMNS, ROWS))
    for number in range(5):
        film.write(np.full((ROWS, COLUMNS, 3), 40 * number, np.uint8))
    film.release()
    with pytest.raises(CameraError, match="MJPG, which is lossy"):
        OpencvCamera(config(path))
    camera = OpencvCamera(config(path, allow_compressed=True))
    assert camera.info.controls["opencv"]["compressed"]
    assert [round(float(camera.read(2.0).pixels.mean()) / 40) for _ in range(5)] == [0, 1, 2, 3, 4]
    camera.close()
