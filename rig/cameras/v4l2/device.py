"""A V4L2 capture device: formats, frame rate and a stream of buffers.

No call blocks for ever: the device is opened non-blocking, and ``poll`` waits for a buffer up to a
deadline. `controls` has the controls, `pixel_formats` the pixels.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import select
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from classify.base.errors import ConfigError
from rig.errors import CameraError

from . import abi

DEV = Path("/dev")


def device_path(device: str) -> str:
    """The path of ``camera.device``: a path, a name in ``/dev/v4l/by-id``, or a number."""
    if "/" in device:
        return device
    return str(DEV / f"video{device}" if device.isdecimal() else DEV / "v4l" / "by-id" / device)


class VideoNode:
    """An open video device, on which no call blocks for ever."""

    def __init__(self, path: str, stream: int) -> None:
        self.path = path
        self._stream = stream
        try:
            import fcntl
        except ImportError as error:
            raise ConfigError(
                f"{path}: V4L2 devices need Linux; set camera.kind = 'opencv' for a camera of this "
                "system"
            ) from error
        self._ioctl = fcntl.ioctl
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise CameraError(f"{path}: {_open_cause(error)}") from error

    def call(self, failure: str, request: int, argument: ctypes._CData) -> None:
        """Do one ioctl; an error becomes a `CameraError` with the device and the text `failure`."""
        try:
            self.try_call(request, argument)
        except OSError as error:
            self.fail(failure, error)

    def try_call(self, request: int, argument: ctypes._CData) -> None:
        """Do one ioctl, again if a signal interrupts it; may raise OSError."""
        if self._fd < 0:
            raise CameraError(f"{self.path}: the camera is closed")
        while True:
            try:
                self._ioctl(self._fd, request, argument, True)
            except InterruptedError:
                continue
            return

    def fail(self, failure: str, error: OSError) -> NoReturn:
        """Raise the `CameraError` for an OSError of this device."""
        if error.errno in (errno.ENODEV, errno.ENXIO):
            cause = "the camera is gone (unplugged, or its driver was removed)"
        elif error.errno == errno.EBUSY:
            cause = f"{failure}: in use by another program; close it and try again"
        elif error.errno == errno.ENOSPC:
            cause = (
                f"{failure}: not enough USB bandwidth; lower the frame rate or the size, or "
                "connect the camera to a separate USB controller"
            )
        else:
            cause = f"{failure}: {error.strerror}"
        raise CameraError(f"{self.path}: {cause}") from error

    def buffer(self, index: int) -> abi.Buffer:
        """The argument of an ioctl about one buffer."""
        return abi.Buffer(index=index, type=self._stream, memory=abi.MEMORY_MMAP)

    def map_buffers(self, count: int) -> dict[int, mmap.mmap]:
        """Map at most `count` buffers by offset; no other program can stream then."""
        request = abi.RequestBuffers(count=count, type=self._stream, memory=abi.MEMORY_MMAP)
        self.call("provides no buffers", abi.Vidioc.REQBUFS, request)
        mapped: dict[int, mmap.mmap] = {}
        try:
            for index in range(request.count):
                buffer = self.buffer(index)
                self.try_call(abi.Vidioc.QUERYBUF, buffer)
                offset = buffer.m.offset
                mapped[offset] = mmap.mmap(self._fd, buffer.length, offset=offset)
        except OSError as error:
            for memory in mapped.values():
                memory.close()
            self.fail("its buffers cannot be mapped", error)
        if not mapped:
            raise CameraError(f"{self.path}: the driver provides no buffers; use another camera")
        return mapped

    def close(self) -> None:
        """Close the device; a second call does nothing."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def _open_cause(error: OSError) -> str:
    if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return "no such camera; ls /dev/v4l/by-id shows those that are plugged in"
    if error.errno in (errno.EACCES, errno.EPERM):
        return "no permission; add the user to the group video and log in again"
    if error.errno == errno.EBUSY:
        return "in use by another program; close it and try again"
    return f"cannot be opened: {error.strerror}"


# Relative tolerance of the frame rate: drivers round 1/30 s to their own units, and the next common
# rate is 25 Hz.
RATE_TOLERANCE = 0.01
# Bounds the lists of a faulty driver; real ones have fewer than 100 entries.
_MAX_LISTED = 512


class NoCaptureDeviceError(CameraError):
    """A video device that delivers no frames."""


@dataclass(frozen=True)
class OfferedFormat:
    """A pixel format that the driver lists, with its frame sizes as text."""

    fourcc: str
    description: str
    sizes: tuple[str, ...]


@dataclass(frozen=True)
class VideoFormat:
    """The parts of a format that the driver decides; a row of `bytes_per_line` may be padded."""

    bytes_per_line: int
    quantization: str


@dataclass(frozen=True, eq=False)
class Capture:
    """One filled buffer, copied out of the driver's memory."""

    data: bytearray
    is_corrupt: bool  # as the driver flags it; `data` may then be short or torn
    timestamp_s: float
    is_monotonic: bool  # whether the stamp is on the monotonic clock
    marks_exposure_start: bool  # as the driver declares its stamp; else it is the frame's end
    sequence: int  # by the driver; a gap is a lost frame


class V4l2Device(VideoNode):
    """An open capture device, best by its permanent name in ``/dev/v4l/by-id/``."""

    def __init__(self, path: str) -> None:
        super().__init__(path, abi.BufType.VIDEO_CAPTURE)
        self._buffers: list[mmap.mmap] = []
        self._streaming = False
        try:
            capability = abi.Capability()
            self.call("is no video device", abi.Vidioc.QUERYCAP, capability)
            self.driver = abi.text(capability.driver)
            self.card = abi.text(capability.card)
            self.bus = abi.text(capability.bus_info)
            # `capabilities` are those of all nodes of a driver, `device_caps` those of this one.
            has_device_caps = capability.capabilities & abi.Cap.DEVICE_CAPS
            capabilities = capability.device_caps if has_device_caps else capability.capabilities
            for flag, word in ((abi.Cap.VIDEO_CAPTURE, "capture"), (abi.Cap.STREAMING, "stream")):
                if not capabilities & flag:
                    raise NoCaptureDeviceError(
                        f"{path}: {self.card} cannot {word}; give the camera's capture node "
                        "(a camera often has a second one for metadata)"
                    )
        except BaseException:
            super().close()
            raise

    def formats(self) -> list[OfferedFormat]:
        """All formats that the driver lists, also those that cannot be decoded here."""
        offered = []
        for index in range(_MAX_LISTED):
            entry = abi.FmtDesc(index=index, type=abi.BufType.VIDEO_CAPTURE)
            if not self._fill_entry("cannot list its formats", abi.Vidioc.ENUM_FMT, entry):
                break
            offered.append(
                OfferedFormat(
                    abi.fourcc_text(entry.pixelformat),
                    abi.text(entry.description),
                    tuple(self._sizes(entry.pixelformat)),
                )
            )
        return offered

    def _sizes(self, pixelformat: int) -> Iterator[str]:
        for index in range(_MAX_LISTED):
            entry = abi.FrmSizeEnum(index=index, pixel_format=pixelformat)
            if not self._fill_entry("cannot list its sizes", abi.Vidioc.ENUM_FRAMESIZES, entry):
                return
            if entry.type != abi.FRMSIZE_TYPE_DISCRETE:
                least_x, most_x, _, least_y, most_y, _ = entry.size
                yield f"{least_x}x{least_y} to {most_x}x{most_y}"
                return
            yield f"{entry.size[0]}x{entry.size[1]}"

    def _fill_entry(self, failure: str, request: int, entry: ctypes._CData) -> bool:
        """Let the driver fill in an entry of a list; False after its end."""
        try:
            self.try_call(request, entry)
        except OSError as error:
            # EINVAL ends a list, ENOTTY is a driver without one.
            if error.errno in (errno.EINVAL, errno.ENOTTY):
                return False
            self.fail(failure, error)
        return True

    def set_format(self, fourcc: str, width_px: int, height_px: int) -> VideoFormat:
        """Set format and size; `CameraError` if the driver chooses others."""
        form = abi.Format(type=abi.BufType.VIDEO_CAPTURE)
        pix = form.fmt.pix
        pix.width, pix.height = width_px, height_px
        pix.pixelformat, pix.field = abi.fourcc(fourcc), abi.FIELD_NONE
        requested = f"{fourcc.strip()} {width_px}x{height_px}"
        refusal = None
        try:
            self.try_call(abi.Vidioc.S_FMT, form)
        except OSError as error:
            # Most drivers replace a format that they lack by their own, some return EINVAL.
            if error.errno != errno.EINVAL:
                self.fail(f"cannot set {requested}", error)
            refusal = "refuses it"
        actual_fourcc = abi.fourcc_text(pix.pixelformat)
        actual = (actual_fourcc, pix.width, pix.height)
        if refusal is None and actual != (fourcc, width_px, height_px):
            refusal = f"gave {actual_fourcc.strip()} {pix.width}x{pix.height}"
        if refusal is None and pix.field != abi.FIELD_NONE:
            refusal = "gives interlaced frames only"
        if refusal is not None:
            raise CameraError(
                f"{self.path}: {requested} was asked for, the driver {refusal}; set "
                f"camera.pixel_format, width_px and height_px to one of {self._offer()}"
            )
        quantization = abi.QUANTIZATION_NAMES.get(pix.quantization, str(pix.quantization))
        return VideoFormat(pix.bytesperline, quantization)

    def _offer(self) -> str:
        offers = (" ".join((form.fourcc.strip(), *form.sizes)) for form in self.formats())
        return "; ".join(offers) or "(an empty list)"

    def set_frame_rate(self, rate_hz: float) -> float:
        """Set the frame rate, and return the frame period in s as read back from the driver."""
        parm = abi.StreamParm(type=abi.BufType.VIDEO_CAPTURE)
        self.call("does not report its frame rate", abi.Vidioc.G_PARM, parm)
        capture = parm.parm.capture
        if capture.capability & abi.Cap.TIMEPERFRAME:
            capture.timeperframe.numerator = 10_000
            capture.timeperframe.denominator = round(10_000 * rate_hz)
            self.call(f"cannot set {rate_hz:g} Hz", abi.Vidioc.S_PARM, parm)
        period = capture.timeperframe
        actual_hz = period.denominator / period.numerator if period.numerator else 0.0
        if not actual_hz > 0.0:
            raise CameraError(f"{self.path}: the driver gives no frame rate; use another camera")
        if abs(actual_hz - rate_hz) > RATE_TOLERANCE * rate_hz:
            raise CameraError(
                f"{self.path}: camera.frame_rate_hz = {rate_hz:g} was asked for, the driver gives "
                f"{actual_hz:g}; set {actual_hz:g}, or a frame size that allows {rate_hz:g}"
            )
        return 1.0 / actual_hz

    def claim(self, buffers: int) -> int:
        """Reserve buffers, so that no other program can stream; return their number."""
        # Keeps other programs from changing controls; drivers without priorities return ENOTTY.
        with suppress(OSError):
            self.try_call(abi.Vidioc.S_PRIORITY, ctypes.c_uint32(abi.PRIORITY_RECORD))
        self._buffers = list(self.map_buffers(buffers).values())
        return len(self._buffers)

    def start(self) -> None:
        """Start to stream into the buffers of `claim`."""
        for index in range(len(self._buffers)):
            self.call("takes no buffer", abi.Vidioc.QBUF, self.buffer(index))
        kind = ctypes.c_int32(abi.BufType.VIDEO_CAPTURE)
        self.call("cannot start to stream", abi.Vidioc.STREAMON, kind)
        self._streaming = True

    def next_capture(self, timeout_s: float) -> Capture:
        """The oldest filled buffer, or the next one."""
        if not self._streaming:
            raise CameraError(f"{self.path}: the camera is closed")
        deadline_s = time.monotonic() + timeout_s
        poll = select.poll()
        poll.register(self._fd, select.POLLIN)
        while True:
            # Also without events from poll: a removed driver may not wake it, but returns ENODEV.
            buffer = self.buffer(0)
            try:
                self.try_call(abi.Vidioc.DQBUF, buffer)
                return self._copied(buffer)
            except BlockingIOError:
                pass
            except OSError as error:
                self.fail("delivers no frame", error)
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0:
                raise CameraError(
                    f"{self.path}: no frame in {timeout_s:g} s; check cable and trigger"
                )
            # Rounded up, because a timeout of 0 ms would make a busy loop.
            events = poll.poll(int(left_s * 1e3) + 1)
            if events and not events[0][1] & select.POLLIN:
                # A device that is gone returns ENODEV here.
                self.call("is gone", abi.Vidioc.QUERYCAP, abi.Capability())
                raise CameraError(
                    f"{self.path}: the driver stopped the stream (hang-up or error); open it again"
                )

    def _copied(self, buffer: abi.Buffer) -> Capture:
        """Copy a buffer, and return it to the driver."""
        with memoryview(self._buffers[buffer.index]) as view:
            data = bytearray(view[: buffer.bytesused])
        flags = buffer.flags
        stamp_s = buffer.timestamp.tv_sec + buffer.timestamp.tv_usec / 1e6
        capture = Capture(
            data=data,
            is_corrupt=bool(flags & abi.BufFlag.ERROR),
            timestamp_s=stamp_s,
            is_monotonic=(flags & abi.BufFlag.TIMESTAMP_MASK == abi.BufFlag.TIMESTAMP_MONOTONIC),
            marks_exposure_start=(
                flags & abi.BufFlag.TSTAMP_SRC_MASK == abi.BufFlag.TSTAMP_SRC_SOE
            ),
            sequence=buffer.sequence,
        )
        self.call("takes no buffer back", abi.Vidioc.QBUF, self.buffer(buffer.index))
        return capture

    def close(self) -> None:
        """Stop the stream and release the device; a second call does nothing."""
        if self._fd < 0:
            return
        self._streaming = False
        # A device that is gone cannot be stopped.
        with suppress(OSError):
            self.try_call(abi.Vidioc.STREAMOFF, ctypes.c_int32(abi.BufType.VIDEO_CAPTURE))
        for buffer in self._buffers:
            buffer.close()
        self._buffers.clear()
        super().close()
