"""A camera through OpenCV, for where there is no V4L2; it knows less, so less is believed."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np

from .camera import CameraInfo, Frame, Pixels
from .config.camera import OpencvCameraConfig
from .errors import CameraError, ControlError, ControlFault
from .v4l2.camera_list import device_path

__all__ = ["OpencvCamera"]

# What OpenCV's backends keep at most, where one does not say.
_UNKNOWN_BUFFERS = 10
_CLOSE_TIMEOUT_S = 2.0
_RATE_TOLERANCE = 0.01
# Of its V4L2 backend the values are the driver's own: manual exposure is 1, a unit is 100 us.
_V4L2 = "V4L2"
_MANUAL = 1.0
_EXPOSURE_UNITS_PER_MS = 10.0


@dataclass(frozen=True, eq=False)
class _Grabbed:
    pixels: Pixels
    came_s: float


class OpencvCamera:
    """An open camera of ``cv2.VideoCapture``.

    OpenCV gives no time stamp of the driver, no sequence number and no error flag, and a read
    that may block for ten seconds. So a thread reads, and frames are numbered as they come: one
    that was lost is not missed. Of the time of a frame only this is known: the driver has so many
    buffers, and one that was handed back can be filled only later. A frame is said to be exposed
    one exposure and one period before that frame came which came one more than all buffers
    earlier. That is never later than the truth, and costs as many frames per light.

    Parameters
    ----------
    config
        With ``kind = "opencv"``. `device` may be what else OpenCV opens, such as a film.

    Raises
    ------
    CameraError
        If it cannot be opened, has not the size or rate, or its exposure cannot be set by hand.
    """

    def __init__(self, config: OpencvCameraConfig) -> None:
        self._config = config
        self._path = device_path(config.device)
        opened_s = time.monotonic()
        self._video = _opened(self._path)
        try:
            self._set_up()
        except BaseException:
            self._video.release()
            raise
        reported = int(self._video.get(cv2.CAP_PROP_BUFFERSIZE))
        self._buffers = reported if 0 < reported <= _UNKNOWN_BUFFERS else _UNKNOWN_BUFFERS
        self._came_s = deque([opened_s] * (self._buffers + 2), maxlen=self._buffers + 2)
        self._sequence = 0
        self._frames: queue.Queue[_Grabbed | CameraError] = queue.Queue(maxsize=1)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._grab, name="opencv camera", daemon=True)
        self._thread.start()

    @property
    def info(self) -> CameraInfo:
        """What holds for every frame."""
        config = self._config
        return CameraInfo(
            kind="opencv",
            name=f"{self._path} ({self._video_backend})",
            width_px=config.width_px,
            height_px=config.height_px,
            bit_depth=8,
            frame_period_s=1.0 / config.frame_rate_hz,
            exposure_s=config.exposure_ms / 1e3,
            # Those in the driver, one that waits for us, and one in the thread's hand.
            queue_length=self._buffers + 2,
            controls={
                "opencv": {
                    "backend": self._video_backend,
                    "fixed_exposure": config.fixed_exposure,
                    "compressed": self._compressed,
                    "time": "bounded by the number of buffers; no time stamps, no sequence numbers",
                    **self._read_back,
                }
            },
        )

    def read(self, timeout_s: float) -> Frame:
        """The oldest frame that OpenCV has, or the next to come."""
        if self._closing.is_set():
            raise CameraError(f"{self._path}: the camera is closed")
        try:
            grabbed = self._frames.get(timeout=timeout_s)
        except queue.Empty:
            raise CameraError(f"{self._path}: no frame in {timeout_s:g} s") from None
        if isinstance(grabbed, CameraError):
            # It stays the answer to every further call.
            with suppress(queue.Full):
                self._frames.put_nowait(grabbed)
            raise CameraError(str(grabbed)) from grabbed
        exposure_s = self._config.exposure_ms / 1e3
        self._came_s.append(grabbed.came_s)
        start_s = self._came_s[0] - exposure_s - 1.0 / self._config.frame_rate_hz
        self._sequence += 1
        return Frame(grabbed.pixels, 8, start_s, start_s + exposure_s, self._sequence)

    def close(self) -> None:
        """Stop reading and release the device; a second call does nothing."""
        self._closing.set()
        with suppress(queue.Empty):
            self._frames.get_nowait()
        # A read that blocks is left to end by itself: the thread then releases the device.
        self._thread.join(_CLOSE_TIMEOUT_S)

    def _grab(self) -> None:
        try:
            while not self._closing.is_set():
                self._put(self._next())
        except CameraError as error:
            self._put(error)
        finally:
            self._video.release()

    def _next(self) -> _Grabbed:
        taken, image = self._video.read()
        came_s = time.monotonic()
        if not taken or image is None:
            raise CameraError(
                f"{self._path}: gives no more frames (unplugged, used by another program, or the "
                "film is over)"
            )
        if image.ndim == 3 and image.shape[2] == 3:
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        if image.ndim != 2 or image.dtype != np.uint8:
            raise CameraError(f"{self._path}: gives {image.shape} {image.dtype}, not 8 bit images")
        return _Grabbed(image.astype(np.uint8, copy=False), came_s)

    def _put(self, item: _Grabbed | CameraError) -> None:
        while not self._closing.is_set():
            with suppress(queue.Full):
                self._frames.put(item, timeout=0.1)
                return

    def _set_up(self) -> None:
        video, config = self._video, self._config
        self._video_backend = video.getBackendName()
        self._read_back: dict[str, float] = {}
        video.set(cv2.CAP_PROP_FRAME_WIDTH, config.width_px)
        video.set(cv2.CAP_PROP_FRAME_HEIGHT, config.height_px)
        video.set(cv2.CAP_PROP_FPS, config.frame_rate_hz)
        width, height = (
            int(video.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        if (width, height) != (config.width_px, config.height_px):
            raise CameraError(
                f"{self._path}: {config.width_px} x {config.height_px} px were asked for, OpenCV "
                f"gives {width} x {height}; set camera.width_px and height_px to that"
            )
        rate_hz = video.get(cv2.CAP_PROP_FPS)
        if rate_hz > 0 and abs(rate_hz - config.frame_rate_hz) > _RATE_TOLERANCE * rate_hz:
            raise CameraError(
                f"{self._path}: camera.frame_rate_hz = {config.frame_rate_hz:g} was asked for, "
                f"OpenCV gives {rate_hz:g}; set that"
            )
        fourcc = int(video.get(cv2.CAP_PROP_FOURCC)) & 0xFFFF_FFFF
        self._compressed = fourcc.to_bytes(4, "little") in (b"MJPG", b"JPEG")
        if self._compressed and not config.allow_compressed:
            raise CameraError(
                f"{self._path}: OpenCV takes the camera's MJPG, which is lossy; use kind = 'v4l2', "
                "or set camera.allow_compressed = true"
            )
        faults = [] if config.fixed_exposure else self._set_exposure()
        # Off where the camera has it; what has no such control says nothing.
        for name in ("AUTO_WB", "AUTOFOCUS", "BACKLIGHT", "SHARPNESS"):
            video.set(getattr(cv2, f"CAP_PROP_{name}"), 0.0)
        for name, value in (("GAIN", config.gain), ("GAMMA", config.gamma)):
            if value is not None:
                faults += self._hold(name, float(value))
        if faults:
            raise ControlError(self._path, *faults)

    def _set_exposure(self) -> list[ControlFault]:
        if self._video_backend != _V4L2:
            raise CameraError(
                f"{self._path}: how OpenCV's backend {self._video_backend} switches automatic "
                "exposure off is not known; if the camera has none, set camera.exposure_ms to what "
                "it does and camera.fixed_exposure = true"
            )
        return [
            *self._hold("AUTO_EXPOSURE", _MANUAL),
            *self._hold("EXPOSURE", round(self._config.exposure_ms * _EXPOSURE_UNITS_PER_MS)),
        ]

    def _hold(self, name: str, value: float) -> list[ControlFault]:
        key = getattr(cv2, f"CAP_PROP_{name}")
        obeyed = self._video.set(key, value)
        held = self._video.get(key)
        self._read_back[name.lower()] = held
        if obeyed and held == value:
            return []
        seen = f"{name.lower()} was set to {value:g} through OpenCV and reads {held:g}"
        advice = "the camera does not obey, or has no such control; use kind = 'v4l2' or another"
        return [ControlFault(name.lower(), seen, advice)]


def _opened(path: str) -> cv2.VideoCapture:
    # Its own complaints would stand beside our one line.
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(0)
    try:
        number = path.removeprefix("/dev/video")
        video = cv2.VideoCapture(int(number) if number.isdecimal() else path)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not video.isOpened():
        raise CameraError(f"{path}: OpenCV cannot open it; is it plugged in, and free?")
    return video
