"""A V4L2 capture device: formats, frame rate and a stream of buffers, over ``ioctl`` and ``mmap``.

Nothing here waits without an end: the device is opened non-blocking and a buffer is awaited by
``poll`` up to a deadline. Controls are in `v4l2_controls`, pixels in `pixel_formats`.
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
from typing import NoReturn

from rig.errors import CameraError

from . import abi
from .buffers import buffer_of, claim_buffers
from .ioctl import ask, explained, open_node

__all__ = ["Capture", "NoCaptureDeviceError", "OfferedFormat", "V4l2Device", "VideoFormat"]

# Drivers round 1/30 s to their own units; 25 instead of 30 Hz is another rate.
_RATE_TOLERANCE = 0.01
# A driver that never ends a list would keep us here.
_MAX_LISTED = 512


class NoCaptureDeviceError(CameraError):
    """A video device that is there, but gives no pictures."""


@dataclass(frozen=True)
class OfferedFormat:
    """A pixel format in the driver's list, and its frame sizes as text."""

    fourcc: str
    description: str
    sizes: tuple[str, ...]


@dataclass(frozen=True)
class VideoFormat:
    """The format that is set.

    `bytes_per_line` counts the padding at the end of a row; `quantization` says whether luma
    fills the whole range.
    """

    fourcc: str
    width_px: int
    height_px: int
    bytes_per_line: int
    quantization: str


@dataclass(frozen=True, eq=False)
class Capture:
    """One filled buffer, copied out of the driver's memory.

    Attributes
    ----------
    data
        The bytes that the driver says it filled.
    is_corrupt
        The driver flagged an error; `data` may be short or torn.
    timestamp_s
        On the monotonic clock, if the driver says so.
    is_monotonic
        Whether it does.
    marks_exposure_start
        Whether the driver calls `timestamp_s` the start of exposure; else it is the frame's end.
    sequence
        The driver's count. A gap is a frame that was lost.
    """

    data: bytearray
    is_corrupt: bool
    timestamp_s: float
    is_monotonic: bool
    marks_exposure_start: bool
    sequence: int


class V4l2Device:
    """An open capture device.

    Parameters
    ----------
    path
        The device, best by a name that stays: ``/dev/v4l/by-id/...``.

    Raises
    ------
    CameraError
        If it is missing, not permitted, or no device that captures and streams.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._buffers: list[mmap.mmap] = []
        self._streaming = False
        self._fd = open_node(path)
        try:
            capability = abi.Capability()
            self.call("is no video device", abi.VIDIOC_QUERYCAP, capability)
            self.driver = abi.text(capability.driver)
            self.card = abi.text(capability.card)
            self.bus = abi.text(capability.bus_info)
            # A driver has several nodes; device_caps is what this one can do.
            separate = capability.capabilities & abi.CAP_DEVICE_CAPS
            able = capability.device_caps if separate else capability.capabilities
            for flag, word in ((abi.CAP_VIDEO_CAPTURE, "capture"), (abi.CAP_STREAMING, "stream")):
                if not able & flag:
                    raise NoCaptureDeviceError(
                        f"{path}: {self.card} cannot {word}; give the camera's capture node "
                        "(a camera often has a second one for metadata)"
                    )
        except BaseException:
            os.close(self._fd)
            raise

    def call(self, purpose: str, request: int, argument: ctypes._CData) -> None:
        """One ioctl; what fails is a `CameraError` that names the device and the purpose."""
        try:
            self.try_call(request, argument)
        except OSError as error:
            self.fail(purpose, error)

    def try_call(self, request: int, argument: ctypes._CData) -> None:
        """One ioctl, again if a signal came in between; may raise OSError."""
        if self._fd < 0:
            raise CameraError(f"{self.path}: the camera is closed")
        ask(self._fd, request, argument)

    def fail(self, purpose: str, error: OSError) -> NoReturn:
        """Raise the `CameraError` that an OSError of this device means."""
        raise explained(self.path, purpose, error) from error

    def formats(self) -> list[OfferedFormat]:
        """What the driver lists, whether we can decode it or not."""
        offered = []
        for index in range(_MAX_LISTED):
            entry = abi.FmtDesc(index=index, type=abi.BUF_TYPE_VIDEO_CAPTURE)
            if not self._listed("cannot list its formats", abi.VIDIOC_ENUM_FMT, entry):
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
            if not self._listed("cannot list its sizes", abi.VIDIOC_ENUM_FRAMESIZES, entry):
                return
            if entry.type != abi.FRMSIZE_TYPE_DISCRETE:
                least_x, most_x, _, least_y, most_y, _ = entry.size
                yield f"{least_x}x{least_y} to {most_x}x{most_y}"
                return
            yield f"{entry.size[0]}x{entry.size[1]}"

    def _listed(self, purpose: str, request: int, entry: ctypes._CData) -> bool:
        try:
            self.try_call(request, entry)
        except OSError as error:
            # EINVAL ends a list, ENOTTY is a driver that has none.
            if error.errno in (errno.EINVAL, errno.ENOTTY):
                return False
            self.fail(purpose, error)
        return True

    def set_format(self, fourcc: str, width_px: int, height_px: int) -> VideoFormat:
        """Set format and size.

        Raises
        ------
        CameraError
            If the driver gave another one than asked for, or another program streams.
        """
        form = abi.Format(type=abi.BUF_TYPE_VIDEO_CAPTURE)
        pix = form.fmt.pix
        pix.width, pix.height = width_px, height_px
        pix.pixelformat, pix.field = abi.fourcc(fourcc), abi.FIELD_NONE
        asked = f"{fourcc.strip()} {width_px}x{height_px}"
        refused = None
        try:
            self.try_call(abi.VIDIOC_S_FMT, form)
        except OSError as error:
            # Most drivers put their own format in place of one they lack, some say EINVAL.
            if error.errno != errno.EINVAL:
                self.fail(f"cannot set {asked}", error)
            refused = "refuses it"
        given_fourcc = abi.fourcc_text(pix.pixelformat)
        if refused is None and (given_fourcc, pix.width, pix.height) != (
            fourcc,
            width_px,
            height_px,
        ):
            refused = f"gave {given_fourcc.strip()} {pix.width}x{pix.height}"
        if refused is None and pix.field != abi.FIELD_NONE:
            refused = "gives interlaced frames only"
        if refused is not None:
            raise CameraError(
                f"{self.path}: {asked} was asked for, the driver {refused}; set "
                f"camera.pixel_format, width_px and height_px to what it offers: {self._offer()}"
            )
        quantization = abi.QUANTIZATION_NAMES.get(pix.quantization, str(pix.quantization))
        return VideoFormat(fourcc, width_px, height_px, pix.bytesperline, quantization)

    def _offer(self) -> str:
        entries = []
        for offered in self.formats():
            sizes = " ".join(offered.sizes)
            entries.append(f"{offered.fourcc.strip()} {sizes}".strip())
        return "; ".join(entries) or "(an empty list)"

    def set_frame_rate(self, rate_hz: float) -> float:
        """Set the frame rate and return the frame period in s as the driver gives it back."""
        parm = abi.StreamParm(type=abi.BUF_TYPE_VIDEO_CAPTURE)
        self.call("does not say its frame rate", abi.VIDIOC_G_PARM, parm)
        capture = parm.parm.capture
        if capture.capability & abi.CAP_TIMEPERFRAME:
            capture.timeperframe.numerator = 10_000
            capture.timeperframe.denominator = round(10_000 * rate_hz)
            self.call(f"cannot set {rate_hz:g} Hz", abi.VIDIOC_S_PARM, parm)
        period = capture.timeperframe
        given_hz = period.denominator / period.numerator if period.numerator else 0.0
        if abs(given_hz - rate_hz) > _RATE_TOLERANCE * rate_hz:
            raise CameraError(
                f"{self.path}: camera.frame_rate_hz = {rate_hz:g} was asked for, the driver gives "
                f"{given_hz:g}; set that, or a size at which it is faster"
            )
        return 1.0 / given_hz

    def claim(self, buffers: int) -> int:
        """Reserve the driver's buffers, so that no other program can stream; return how many."""
        # Keeps other programs from changing controls; drivers without priorities say ENOTTY.
        with suppress(OSError):
            self.try_call(abi.VIDIOC_S_PRIORITY, ctypes.c_uint32(abi.PRIORITY_RECORD))
        mapped = claim_buffers(self._fd, self.path, abi.BUF_TYPE_VIDEO_CAPTURE, buffers)
        self._buffers = list(mapped.values())
        return len(self._buffers)

    def start(self) -> None:
        """Begin to stream into the buffers of `claim`."""
        for index in range(len(self._buffers)):
            self.call("takes no buffer", abi.VIDIOC_QBUF, self._buffer(index))
        kind = ctypes.c_int32(abi.BUF_TYPE_VIDEO_CAPTURE)
        self.call("cannot start to stream", abi.VIDIOC_STREAMON, kind)
        self._streaming = True

    def next_capture(self, timeout_s: float) -> Capture:
        """The oldest filled buffer, or the next to be filled.

        Raises
        ------
        CameraError
            If none comes in time, or the device is gone.
        """
        if not self._streaming:
            raise CameraError(f"{self.path}: the camera is closed")
        deadline_s = time.monotonic() + timeout_s
        poll = select.poll()
        poll.register(self._fd, select.POLLIN)
        while True:
            # Also when poll saw nothing: a driver that died may wake nobody, but it says ENODEV.
            buffer = self._filled_buffer()
            if buffer is not None:
                return self._taken(buffer)
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0:
                raise CameraError(f"{self.path}: no frame in {timeout_s:g} s")
            # Rounded up, else the last part of a millisecond would be spent in a busy loop.
            events = poll.poll(int(left_s * 1e3) + 1)
            if events and not events[0][1] & select.POLLIN:
                self._explain_hang_up()

    def _explain_hang_up(self) -> NoReturn:
        # A device that is gone says so itself, if it can.
        self.call("is gone", abi.VIDIOC_QUERYCAP, abi.Capability())
        raise CameraError(
            f"{self.path}: the driver stopped the stream (hang-up or error); open it again"
        )

    def _filled_buffer(self) -> abi.Buffer | None:
        buffer = self._buffer(0)
        try:
            self.try_call(abi.VIDIOC_DQBUF, buffer)
        except BlockingIOError:
            return None
        except OSError as error:
            self.fail("gives no frame", error)
        return buffer

    def _taken(self, buffer: abi.Buffer) -> Capture:
        """Copy a buffer out and give it back to the driver."""
        with memoryview(self._buffers[buffer.index]) as view:
            data = bytearray(view[: buffer.bytesused])
        flags = buffer.flags
        stamp_s = buffer.timestamp.tv_sec + buffer.timestamp.tv_usec / 1e6
        capture = Capture(
            data=data,
            is_corrupt=bool(flags & abi.BUF_FLAG_ERROR),
            timestamp_s=stamp_s,
            is_monotonic=(flags & abi.BUF_FLAG_TIMESTAMP_MASK == abi.BUF_FLAG_TIMESTAMP_MONOTONIC),
            marks_exposure_start=(
                flags & abi.BUF_FLAG_TSTAMP_SRC_MASK == abi.BUF_FLAG_TSTAMP_SRC_SOE
            ),
            sequence=buffer.sequence,
        )
        self.call("takes no buffer back", abi.VIDIOC_QBUF, self._buffer(buffer.index))
        return capture

    def _buffer(self, index: int) -> abi.Buffer:
        return buffer_of(abi.BUF_TYPE_VIDEO_CAPTURE, index)

    def close(self) -> None:
        """Stop the stream and release the device; a second call does nothing."""
        if self._fd < 0:
            return
        self._streaming = False
        # A device that is gone cannot be stopped, and need not be.
        with suppress(OSError):
            self.try_call(abi.VIDIOC_STREAMOFF, ctypes.c_int32(abi.BUF_TYPE_VIDEO_CAPTURE))
        for buffer in self._buffers:
            buffer.close()
        self._buffers.clear()
        os.close(self._fd)
        self._fd = -1
