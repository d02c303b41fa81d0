"""A V4L2 camera in measurement mode: nothing automatic, every control read back."""

import re
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rig.cameras.camera import CameraInfo, Frame, ListedCamera, Pixels, require_exposure
from rig.errors import CameraError

from .abi import Cid
from .controls import find_control, list_controls, read_control
from .device import (
    DEV,
    Capture,
    NoCaptureDeviceError,
    OfferedFormat,
    V4l2Device,
    VideoFormat,
    device_path,
)
from .measurement_mode import (
    EXPOSURE_UNITS_PER_MS,
    V4l2CameraConfig,
    check_measurement_mode,
    exposure_range_ms,
    pixel_values,
    set_exposure,
    set_measurement_mode,
)
from .pixel_formats import PIXEL_FORMATS, CorruptFrameError, decode

# Number of buffers in the queue. With more of them, more frames are stale after a switch of the
# lights; with fewer than 3, drivers lose frames.
_BUFFERS = 4
_LUMA = ("YUYV", "UYVY")
# White in the limited range is 235 (BT.601); drivers that round down stop at 234.
_LIMITED_WHITE = 234


class V4l2Camera:
    """A streaming V4L2 camera in measurement mode.

    Its buffers are claimed before any control is set, so that a second program fails before it
    changes a control.
    """

    def __init__(self, config: V4l2CameraConfig) -> None:
        config.require_measured_mode()
        self._config = config
        self._numbering: FrameNumbering | None = None  # of a loopback device
        self._pixel_format = PIXEL_FORMATS[config.pixel_format]
        self._device = V4l2Device(device_path(config.device))
        try:
            device = self._device
            self._format = device.set_format(
                self._pixel_format.fourcc, config.width_px, config.height_px
            )
            self._period_s = device.set_frame_rate(config.frame_rate_hz)
            self._queue_length = device.claim(_BUFFERS)
            if config.timestamp_marks == "writer":
                self._numbering = FrameNumbering(time.monotonic(), self._period_s)
            self._mode = set_measurement_mode(device, config)
            device.start()
            # Some cameras load their own settings when they start to stream.
            check_measurement_mode(device, self._mode)
            self._pixel_values = pixel_values(device)
            self._controls = _record(device, self._format, config)
        except BaseException:
            self._device.close()
            raise

    @property
    def info(self) -> CameraInfo:
        return CameraInfo(
            kind="v4l2",
            name=self._device.card,
            width_px=self._config.width_px,
            height_px=self._config.height_px,
            bit_depth=self._pixel_format.bit_depth,
            frame_period_s=self._period_s,
            exposure_s=self._mode.exposure_s,
            queue_length=self._queue_length,
            readout_s=self._config.readout_s,
            start_uncertainty_s=self._config.start_uncertainty_s,
            controls=self._controls,
            **self._pixel_values,
        )

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        """Shortest and longest exposure that fits into a frame."""
        shortest_ms, longest_ms = exposure_range_ms(self._device, self._config)
        return shortest_ms, max(shortest_ms, min(longest_ms, 1e3 * self._period_s))

    def set_exposure(self, exposure_ms: float) -> None:
        """Change the exposure, in steps of 0.1 ms, and read it back."""
        require_exposure(exposure_ms, self.exposure_range_ms)
        if not self._config.fixed_exposure:
            self._mode = set_exposure(self._device, self._mode, exposure_ms)

    def read(self, timeout_s: float) -> Frame:
        """The oldest frame in the queue, or the next one; a corrupt frame is all 0."""
        capture = self._next_capture(timeout_s)
        start_s = self._config.exposure_start_s(
            capture.timestamp_s,
            claims_start=capture.marks_exposure_start,
            period_s=self._period_s,
            exposure_s=self._mode.exposure_s,
        )
        try:
            pixels, is_corrupt = self._decoded(capture), False
        except CorruptFrameError:
            blank = np.zeros((self._config.height_px, self._config.width_px), np.uint16)
            pixels = blank.astype(np.uint8) if self._pixel_format.bit_depth == 8 else blank
            is_corrupt = True
        return Frame(
            pixels=pixels,
            bit_depth=self._pixel_format.bit_depth,
            exposure_start_s=start_s,
            exposure_end_s=start_s + self._mode.exposure_s,
            sequence=capture.sequence,
            is_corrupt=is_corrupt,
        )

    def close(self) -> None:
        self._device.close()

    def _next_capture(self, timeout_s: float) -> Capture:
        deadline_s = time.monotonic() + timeout_s
        capture = self._device.next_capture(timeout_s)
        if self._numbering is not None:
            while (number := self._numbering.number_of(capture.timestamp_s)) is None:
                left_s = max(0.0, deadline_s - time.monotonic())
                try:
                    capture = self._device.next_capture(left_s)
                except CameraError as error:
                    if time.monotonic() < deadline_s:
                        raise
                    raise CameraError(
                        f"{self._device.path}: frames arrive, but in {timeout_s:g} s none had the "
                        f"time stamp of a writer of {1.0 / self._period_s:g} Hz, whole periods "
                        "after the last one; set camera.frame_rate_hz to the writer's rate, and "
                        "open it again"
                    ) from error
            return replace(capture, sequence=number)
        if not capture.is_monotonic:
            raise CameraError(
                f"{self._device.path}: the time stamps of driver {self._device.driver} are not on "
                "the monotonic clock, so that stale frames cannot be recognised; use another "
                "camera, or for a loopback device set camera.timestamp_marks = 'writer'"
            )
        return capture

    def _decoded(self, capture: Capture) -> Pixels:
        size, form = (self._config.width_px, self._config.height_px), self._format
        if capture.is_corrupt:
            raise CorruptFrameError
        try:
            pixels = decode(self._pixel_format, capture.data, *size, form.bytes_per_line)
        except CameraError as error:
            raise type(error)(f"{self._device.path}: frame {capture.sequence}: {error}") from error
        if self._pixel_format.name in _LUMA and form.quantization != "full range":
            # White is the largest value of the limited range: mark it as saturated.
            pixels[pixels >= _LIMITED_WHITE] = 255
        return pixels


def _record(device: V4l2Device, form: VideoFormat, config: V4l2CameraConfig) -> dict[str, Any]:
    """The camera's state for a set's metadata: all controls, pixel format and time stamps."""
    record: dict[str, Any] = {
        control.slug: read_control(device, control)
        for control in list_controls(device)
        if control.is_readable
    }
    record["v4l2"] = {
        "driver": device.driver,
        "bus": device.bus,
        "pixel_format": config.pixel_format,
        "compressed": PIXEL_FORMATS[config.pixel_format].is_compressed,
        "quantization": form.quantization,
        "fixed_exposure": config.fixed_exposure,
        **config.timing_record,
    }
    return record


# Tolerance of a stamp, in periods. The writer's stamps are exact to a microsecond, the reported
# period to 1e-9 s: over 500 periods at 1 kHz (test_frame_numbering.py) the error adds up to 0.002.
_PERIOD_TOLERANCE = 0.01


class FrameNumbering:
    """Numbers the frames of ``v4l2loopback``, which has no counter, by their time stamps.

    When a program claims buffers, the driver replaces all stamps. The writer's own stamps are later
    than that, `opened_s`, and whole periods apart.
    """

    def __init__(self, opened_s: float, period_s: float) -> None:
        self._opened_s = opened_s
        self._period_s = period_s
        self._last: tuple[int, float] | None = None

    def number_of(self, stamp_s: float) -> int | None:
        """The number of the frame stamped `stamp_s`; None if the stamp is not the writer's."""
        if stamp_s <= self._opened_s:
            return None
        if self._last is None:
            self._last = (0, stamp_s)
            return 0
        number, last_s = self._last
        periods = (stamp_s - last_s) / self._period_s
        steps = round(periods)
        if abs(periods - steps) > _PERIOD_TOLERANCE:
            return None
        self._last = (number + steps, stamp_s)
        return number + steps


# Pixel formats, best first: grey before colour, whose filters cost light and resolution; more bits
# before fewer; compressed last.
_PREFERRED = sorted(
    PIXEL_FORMATS,
    key=lambda name: (
        name == "MJPG",
        not name.startswith(("Y1", "GREY")),
        name in ("RGB24", "BGR24"),
        -PIXEL_FORMATS[name].bit_depth,
    ),
)
# Larger frames seldom reach 30 Hz over USB 2, and then the camera is not opened.
_MAX_COLUMNS = 1280


def list_v4l2_cameras(dev: Path = DEV) -> list[ListedCamera]:
    """List every capture node by its number; one that cannot be queried has a `problem`."""
    nodes = [path for path in dev.glob("video*") if path.name[len("video") :].isdecimal()]
    permanent_names = sorted((dev / "v4l" / "by-id").glob("*"))
    cameras = []
    for node in sorted(nodes, key=lambda path: int(path.name[len("video") :])):
        names = (name for name in permanent_names if name.resolve() == node.resolve())
        device = str(next(names, node))
        try:
            cameras.append(_listed(node, device))
        except NoCaptureDeviceError:
            continue
        except CameraError as error:
            cameras.append(ListedCamera("v4l2", device, node=node, problem=str(error)))
    return cameras


def _listed(node: Path, device_name: str) -> ListedCamera:
    device = V4l2Device(str(node))
    try:
        exposure = find_control(device, Cid.EXPOSURE_ABSOLUTE)
        formats = tuple(device.formats())
        return ListedCamera(
            "v4l2",
            device_name,
            device.card,
            device.driver,
            node,
            tuple(f"{offered.fourcc} {' '.join(offered.sizes)}".rstrip() for offered in formats),
            None if exposure is None else exposure.maximum / EXPOSURE_UNITS_PER_MS,
            config_lines(formats),
        )
    finally:
        device.close()


def config_lines(formats: Iterable[OfferedFormat]) -> tuple[str, ...]:
    """Lines of ``[camera]`` with the best offered format that can be decoded; empty without one."""
    sizes = {offered.fourcc.strip(): offered.sizes for offered in formats}
    fourccs = {name: PIXEL_FORMATS[name].fourcc.strip() for name in _PREFERRED}
    name = next((name for name, fourcc in fourccs.items() if fourcc in sizes), None)
    if name is None:
        return ()
    width_px, height_px = _preferred_size(sizes[fourccs[name]])
    lines = [f'pixel_format = "{name}"', f"width_px = {width_px}", f"height_px = {height_px}"]
    if name == "MJPG":
        lines.append("allow_compressed = true        # its losses are in every slope")
    return tuple(lines)


def _preferred_size(texts: Iterable[str]) -> tuple[int, int]:
    """The largest listed size of at most `_MAX_COLUMNS`, else the smallest; 512 x 512 if none."""
    matches = [re.fullmatch(r"(\d+)x(\d+)", text) for text in texts]
    sizes = [(int(match[1]), int(match[2])) for match in matches if match]
    small = [size for size in sizes if size[0] <= _MAX_COLUMNS]
    return max(small, default=min(sizes, default=(512, 512)))
