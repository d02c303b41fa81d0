"""Motion JPEG frames: damage is noticed, and what cameras leave out or append is not damage."""

from collections import deque

import cv2
import numpy as np
import pytest

from rig import CameraError
from rig.cameras.v4l2 import camera
from rig.cameras.v4l2.camera import V4l2Camera
from rig.cameras.v4l2.device import Capture
from rig.cameras.v4l2.measurement_mode import V4l2CameraConfig
from rig.cameras.v4l2.pixel_formats import PIXEL_FORMATS, CorruptFrameError, decode
from tests.rig.cameras.v4l2.test_measurement_mode import StreamingCamera

WIDTH, HEIGHT = 320, 240
MJPG = PIXEL_FORMATS["MJPG"]
HUFFMAN_TABLES, SCAN = 0xC4, 0xDA


def frame(quality: int = 90, *options: int) -> bytes:
    """A textured colour picture, as a camera compresses it."""
    rng = np.random.default_rng(1)
    noise = cv2.GaussianBlur(rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8), (0, 0), 3)
    image = cv2.normalize(noise, np.empty_like(noise), 0, 250, cv2.NORM_MINMAX)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality, *options])[1].tobytes()


def without_huffman_tables(data: bytes) -> bytes:
    kept, start = [data[:2]], 2
    while (marker := data[start + 1]) != SCAN:
        end = start + 2 + int.from_bytes(data[start + 2 : start + 4], "big")
        kept += [data[start:end]] if marker != HUFFMAN_TABLES else []
        start = end
    return b"".join([*kept, data[start:]])


FRAMES = {
    "4:2:0": frame(),
    "4:2:2": frame(
        90, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422
    ),
    "restart markers": frame(90, cv2.IMWRITE_JPEG_RST_INTERVAL, 20),
}  # fmt: skip


@pytest.mark.parametrize("data", FRAMES.values(), ids=FRAMES)
@pytest.mark.parametrize("padding", [b"", bytes(1), bytes(5000)])
def test_whole_frames_have_their_luma(data: bytes, padding: bytes) -> None:
    luma = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    bare = without_huffman_tables(data)
    assert len(bare) == len(data) - 432  # the standard tables and their markers
    for content in (data, bare):
        pixels = decode(MJPG, bytearray(content + padding), WIDTH, HEIGHT, 0)
        np.testing.assert_array_equal(pixels, luma)


@pytest.mark.parametrize("data", FRAMES.values(), ids=FRAMES)
def test_a_frame_that_lacks_bytes_is_corrupt(data: bytes) -> None:
    missing = 1000
    damaged = [
        data[:start] + data[start + missing :] for start in range(700, len(data) - 1000, 499)
    ]
    damaged += [data[:-missing], data[:-missing] + bytes(missing), data[:-1], data[:200], data[1:]]
    for content in damaged:
        for variant in (content, content + bytes(64)):
            with pytest.raises(CorruptFrameError, match=r"MJPG frame of \d+ bytes"):
                decode(MJPG, variant, WIDTH, HEIGHT, 0)


def test_a_size_that_was_not_asked_for_is_no_damage() -> None:
    with pytest.raises(CameraError, match=r"320 x 240 px .* 640 x 480") as caught:
        decode(MJPG, FRAMES["4:2:0"], 640, 480, 0)
    assert caught.type is CameraError


class FilmedCamera(StreamingCamera):
    """Streams three frames, of which the second lacks its end."""

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.buffers = deque([FRAMES["4:2:0"], FRAMES["4:2:0"][:-1000], FRAMES["4:2:2"]])

    def next_capture(self, _: float) -> Capture:
        count = 3 - len(self.buffers)
        data = bytearray(self.buffers.popleft())
        return Capture(data, False, 1.0 + count / 30, True, False, count)


def test_a_camera_flags_a_damaged_frame_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera, "V4l2Device", FilmedCamera)
    config = V4l2CameraConfig(
        device="/dev/video9", pixel_format="MJPG", allow_compressed=True, width_px=WIDTH,
        height_px=HEIGHT, exposure_ms=10.0,
    )  # fmt: skip
    opened = V4l2Camera(config)
    frames = [opened.read(1.0) for _ in range(3)]
    assert [image.is_corrupt for image in frames] == [False, True, False]
    assert [image.pixels.any() for image in frames] == [True, False, True]
    assert {(image.pixels.shape, image.pixels.dtype) for image in frames} == {
        ((HEIGHT, WIDTH), np.dtype(np.uint8))
    }
