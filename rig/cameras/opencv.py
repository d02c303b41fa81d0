"""A camera through OpenCV, for systems without V4L2; its frame times are only bounded."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rig.errors import CameraError, CameraFault, ControlError

from .camera import CameraInfo, Frame, Pixels, require_exposure
from .v4l2.device import RATE_TOLERANCE, device_path
from .v4l2.measurement_mode import VideoCameraConfig

# Imported by the functions that need it, so that a configuration is read without loading it.
if TYPE_CHECKING:
    import cv2

# Assumed if the backend does not report its buffers: the most that OpenCV's V4L2 backend has.
_UNKNOWN_BUFFERS = 10
# Time that `close` waits for a blocked read; after that the thread ends by itself.
_CLOSE_TIMEOUT_S = 2.0
# OpenCV's V4L2 backend passes the driver's values on: manual exposure is 1, a unit is 100 us.
_V4L2 = "V4L2"
_MANUAL_EXPOSURE = 1.0
_EXPOSURE_UNITS_PER_MS = 10.0
# Properties of OpenCV, beside gain and gamma, that change the pixel value of the same light.
_PIXEL_VALUE_CONTROLS = (
    "BRIGHTNESS",
    "CONTRAST",
    "BACKLIGHT",
    "ISO_SPEED",
    "WB_TEMPERATURE",
    "WHITE_BALANCE_BLUE_U",
    "WHITE_BALANCE_RED_V",
)
# Value that OpenCV returns for a property that the camera lacks.
_LACKING_VALUE = -1.0

_ArrivedImage = tuple[Pixels, float]
"""Pixels, and the time of their arrival in s."""


class OpencvCameraConfig(VideoCameraConfig):
    """A camera through OpenCV, with 8 bits; `OpencvCamera` bounds the times of its frames."""

    kind: Literal["opencv"] = "opencv"
    bits: Literal[8] = 8


class OpencvCamera:
    """A camera of ``cv2.VideoCapture``, which gives frames no time stamps.

    `exposure_start_s` is the earliest possible start. With n buffers, that is one exposure and one
    frame period before the arrival of the frame n + 1 places earlier.
    """

    def __init__(self, config: OpencvCameraConfig) -> None:
        self._config = config
        self._exposure_ms = config.exposure_ms
        self._path = device_path(config.device)
        opened_s = time.monotonic()
        self._video = _open_video(self._path)
        try:
            self._configure()
        except BaseException:
            self._video.release()
            raise
        reported = int(self._video.get(_property("BUFFERSIZE")))
        self._buffers = reported if 0 < reported <= _UNKNOWN_BUFFERS else _UNKNOWN_BUFFERS
        self._arrived_s = deque([opened_s] * (self._buffers + 2), maxlen=self._buffers + 2)
        self._sequence = 0
        self._frames: queue.Queue[_ArrivedImage | CameraError] = queue.Queue(maxsize=1)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._grab, name="opencv camera", daemon=True)
        self._thread.start()

    @property
    def info(self) -> CameraInfo:
        config = self._config
        return CameraInfo(
            kind="opencv",
            name=f"{self._path} ({self._video_backend})",
            width_px=config.width_px,
            height_px=config.height_px,
            bit_depth=8,
            frame_period_s=1.0 / config.frame_rate_hz,
            exposure_s=self._exposure_ms / 1e3,
            # Frames wait in the driver's buffers, in the queue and in the thread.
            queue_length=self._buffers + 2,
            **self._pixel_values,
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

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        """One unit of the control to a frame period; OpenCV does not report the true range."""
        if self._config.fixed_exposure:
            return self._exposure_ms, self._exposure_ms
        return 1.0 / _EXPOSURE_UNITS_PER_MS, 1e3 / self._config.frame_rate_hz

    def set_exposure(self, exposure_ms: float) -> None:
        """Change the exposure in steps of 0.1 ms, and read it back."""
        require_exposure(exposure_ms, self.exposure_range_ms)
        if self._config.fixed_exposure:
            return
        if faults := self._set_exposure_time(exposure_ms):
            raise ControlError(self._path, *faults)

    def read(self, timeout_s: float) -> Frame:
        if self._closing.is_set():
            raise CameraError(f"{self._path}: the camera is closed")
        try:
            arrived = self._frames.get(timeout=timeout_s)
        except queue.Empty:
            raise CameraError(
                f"{self._path}: no frame in {timeout_s:g} s; check the cable"
            ) from None
        if isinstance(arrived, CameraError):
            # Put back, so that every later call raises it again.
            with suppress(queue.Full):
                self._frames.put_nowait(arrived)
            raise CameraError(str(arrived)) from arrived
        exposure_s = self._exposure_ms / 1e3
        pixels, arrived_s = arrived
        self._arrived_s.append(arrived_s)
        start_s = self._arrived_s[0] - exposure_s - 1.0 / self._config.frame_rate_hz
        self._sequence += 1
        return Frame(pixels, 8, start_s, start_s + exposure_s, self._sequence)

    def close(self) -> None:
        self._closing.set()
        with suppress(queue.Empty):
            self._frames.get_nowait()
        # A read that still blocks ends by itself, and the thread then releases the device.
        self._thread.join(_CLOSE_TIMEOUT_S)

    def _grab(self) -> None:
        try:
            while not self._closing.is_set():
                self._put(self._next())
        except CameraError as error:
            self._put(error)
        finally:
            self._video.release()

    def _next(self) -> _ArrivedImage:
        is_read, image = self._video.read()
        arrived_s = time.monotonic()
        if not is_read or image is None:
            raise CameraError(
                f"{self._path}: no more frames; the camera is unplugged or used by another "
                "program, or the video has ended"
            )
        if image.ndim == 3 and image.shape[2] == 3:
            import cv2

            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        if image.ndim != 2 or image.dtype != np.uint8:
            raise CameraError(
                f"{self._path}: OpenCV delivers {image.shape} {image.dtype} instead of 8-bit images"
            )
        return image.astype(np.uint8, copy=False), arrived_s

    def _put(self, image_or_error: _ArrivedImage | CameraError) -> None:
        while not self._closing.is_set():
            with suppress(queue.Full):
                self._frames.put(image_or_error, timeout=0.1)
                return

    def _configure(self) -> None:
        video, config = self._video, self._config
        self._video_backend = video.getBackendName()
        self._read_back: dict[str, float] = {}
        video.set(_property("FRAME_WIDTH"), config.width_px)
        video.set(_property("FRAME_HEIGHT"), config.height_px)
        video.set(_property("FPS"), config.frame_rate_hz)
        width, height = (
            int(video.get(_property(name))) for name in ("FRAME_WIDTH", "FRAME_HEIGHT")
        )
        if (width, height) != (config.width_px, config.height_px):
            raise CameraError(
                f"{self._path}: {config.width_px} x {config.height_px} px were asked for, OpenCV "
                f"gives {width} x {height}; set camera.width_px and height_px to that"
            )
        rate_hz = video.get(_property("FPS"))
        if rate_hz > 0 and abs(rate_hz - config.frame_rate_hz) > RATE_TOLERANCE * rate_hz:
            raise CameraError(
                f"{self._path}: camera.frame_rate_hz = {config.frame_rate_hz:g} was asked for, "
                f"OpenCV gives {rate_hz:g}; set {rate_hz:g}"
            )
        fourcc = int(video.get(_property("FOURCC"))) & 0xFFFF_FFFF
        self._compressed = fourcc.to_bytes(4, "little") in (b"MJPG", b"JPEG")
        if self._compressed and not config.allow_compressed:
            raise CameraError(
                f"{self._path}: OpenCV uses the camera's MJPG, which is lossy; use kind = 'v4l2', "
                "or set camera.allow_compressed = true"
            )
        faults = [] if config.fixed_exposure else self._set_manual_exposure()
        # Turned off if the camera has them; otherwise `set` has no effect.
        for name in ("AUTO_WB", "AUTOFOCUS", "BACKLIGHT", "SHARPNESS"):
            video.set(_property(name), 0.0)
        for name, value in (("GAIN", config.gain), ("GAMMA", config.gamma)):
            if value is not None:
                faults += self._set(name, float(value))
        if faults:
            raise ControlError(self._path, *faults)
        # Read here, before the thread that reads frames starts.
        names = ("GAIN", "GAMMA", *_PIXEL_VALUE_CONTROLS)
        states = {name: video.get(_property(name)) for name in names}
        values = {name.lower(): value for name, value in states.items() if value != _LACKING_VALUE}
        gain_and_gamma = {name: values.pop(name, None) for name in ("gain", "gamma")}
        self._pixel_values: dict[str, Any] = {**gain_and_gamma, "pixel_value_controls": values}

    def _set_manual_exposure(self) -> list[CameraFault]:
        if self._video_backend != _V4L2:
            raise CameraError(
                f"{self._path}: automatic exposure cannot be turned off through OpenCV's backend "
                f"{self._video_backend}; if the camera has none, set camera.exposure_ms to its "
                "exposure and camera.fixed_exposure = true"
            )
        return [
            *self._set("AUTO_EXPOSURE", _MANUAL_EXPOSURE),
            *self._set_exposure_time(self._config.exposure_ms),
        ]

    def _set_exposure_time(self, exposure_ms: float) -> list[CameraFault]:
        units = max(1, round(exposure_ms * _EXPOSURE_UNITS_PER_MS))
        faults = self._set("EXPOSURE", units)
        if not faults:
            self._exposure_ms = units / _EXPOSURE_UNITS_PER_MS
        return faults

    def _set(self, name: str, value: float) -> list[CameraFault]:
        key = _property(name)
        accepted = self._video.set(key, value)
        read_back = self._video.get(key)
        self._read_back[name.lower()] = read_back
        if accepted and read_back == value:
            return []
        finding = f"{name.lower()} was set to {value:g} through OpenCV and reads {read_back:g}"
        advice = (
            "the camera does not obey, or lacks the control; use kind = 'v4l2' or another camera"
        )
        return [CameraFault(name.lower(), finding, advice)]


def _property(name: str) -> int:
    import cv2

    return int(getattr(cv2, f"CAP_PROP_{name}"))


def _open_video(path: str) -> cv2.VideoCapture:
    import cv2

    # Suppress messages that OpenCV prints.
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(0)
    try:
        number = path.removeprefix("/dev/video")
        video = cv2.VideoCapture(int(number) if number.isdecimal() else path)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not video.isOpened():
        raise CameraError(
            f"{path}: OpenCV cannot open it; plug it in, and close other programs that use it"
        )
    return video
