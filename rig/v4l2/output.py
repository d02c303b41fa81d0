"""Writing frames into a V4L2 loopback device, whose other side other programs see as a camera."""

from __future__ import annotations

import ctypes
import fcntl
import mmap
import os

from rig.errors import CameraError

from . import abi
from .buffers import buffer_of, claim_buffers
from .ioctl import ask, explained, open_node

__all__ = ["V4l2Output"]

# One is read while the next is written; the driver may have fewer.
_BUFFERS = 4


class V4l2Output:
    """An open loopback device that is written to.

    Its driver hands each buffer on at once and never holds one back. A frame keeps the time stamp
    that it is given here: the driver's own would be that of the writing, however late that was.

    Parameters
    ----------
    path
        Such as what ``v4l2loopback`` makes.
    fourcc, width_px, height_px, bytes_per_line
        The frames' format.
    period_s
        What the driver tells readers.

    Raises
    ------
    CameraError
        If it is missing, in use, takes no frames, or not this format.
    """

    def __init__(
        self,
        path: str,
        *,
        fourcc: str,
        width_px: int,
        height_px: int,
        bytes_per_line: int,
        period_s: float,
    ) -> None:
        self._frame_bytes = bytes_per_line * height_px
        self._maps: dict[int, mmap.mmap] = {}
        self._written = 0
        self._path = path
        self._fd = open_node(path)
        try:
            self._claim()
            self._set_format(fourcc, width_px, height_px, bytes_per_line)
            self._set_period(period_s)
            self._maps = claim_buffers(self._fd, path, abi.BUF_TYPE_VIDEO_OUTPUT, _BUFFERS)
            kind = ctypes.c_int32(abi.BUF_TYPE_VIDEO_OUTPUT)
            self._call("takes no stream", abi.VIDIOC_STREAMON, kind)
        except BaseException:
            self.close()
            raise

    def write(self, frame: bytes, timestamp_s: float) -> None:
        """Hand a frame to whoever reads.

        Parameters
        ----------
        frame
            As many bytes as its format has.
        timestamp_s
            Its end on the monotonic clock.
        """
        if len(frame) != self._frame_bytes:
            raise ValueError(f"a frame of {len(frame)} bytes instead of {self._frame_bytes}")
        buffer = self._buffer(self._written % len(self._maps))
        # Asked each time: a reader that wants fewer buffers moves those that there are.
        self._call("has lost a buffer", abi.VIDIOC_QUERYBUF, buffer)
        self._maps[buffer.m.offset][: len(frame)] = frame
        buffer.bytesused = len(frame)
        buffer.field = abi.FIELD_NONE
        whole_us = round(timestamp_s * 1e6)
        buffer.timestamp.tv_sec, buffer.timestamp.tv_usec = divmod(whole_us, 1_000_000)
        self._call("takes no frame", abi.VIDIOC_QBUF, buffer)
        self._written += 1

    def close(self) -> None:
        """End the stream and release the device; a second call does nothing."""
        for mapped in self._maps.values():
            mapped.close()
        self._maps.clear()
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _call(self, purpose: str, request: int, argument: ctypes._CData) -> None:
        try:
            ask(self._fd, request, argument)
        except OSError as error:
            raise explained(self._path, purpose, error) from error

    def _claim(self) -> None:
        """Make sure that it can be written to and that nobody of our kind does already."""
        capability = abi.Capability()
        self._call("is no video device", abi.VIDIOC_QUERYCAP, capability)
        able = abi.CAP_VIDEO_OUTPUT | abi.CAP_STREAMING
        if capability.device_caps & able != able:
            raise CameraError(
                f"{self._path}: {abi.text(capability.card)} takes no frames; give a loopback "
                "device, which modprobe v4l2loopback makes"
            )
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise CameraError(
                f"{self._path}: another simulated rig writes to it; stop that"
            ) from error

    def _set_format(self, fourcc: str, width_px: int, height_px: int, bytes_per_line: int) -> None:
        form = abi.Format(type=abi.BUF_TYPE_VIDEO_OUTPUT)
        pix = form.fmt.pix
        pix.width, pix.height, pix.pixelformat = width_px, height_px, abi.fourcc(fourcc)
        pix.field, pix.bytesperline = abi.FIELD_NONE, bytes_per_line
        asked = f"{fourcc.strip()} {width_px}x{height_px}"
        self._call(f"does not take {asked}", abi.VIDIOC_S_FMT, form)
        given = (abi.fourcc_text(pix.pixelformat), pix.width, pix.height)
        if given == (fourcc, width_px, height_px) and pix.bytesperline != bytes_per_line:
            # v4l2loopback takes Y10 and Y12 for packed, and has no room for their words.
            raise CameraError(
                f"{self._path}: the driver gives a line of {asked} {pix.bytesperline} bytes "
                f"instead of {bytes_per_line}; set camera.pixel_format to GREY or Y16"
            )
        if given != (fourcc, width_px, height_px):
            raise CameraError(
                f"{self._path}: {asked} was asked for, the driver gave "
                f"{given[0].strip()} {pix.width}x{pix.height}; if a program has it open with "
                "that, close it"
            )

    def _set_period(self, period_s: float) -> None:
        parm = abi.StreamParm(type=abi.BUF_TYPE_VIDEO_OUTPUT)
        interval = parm.parm.capture.timeperframe
        interval.numerator, interval.denominator = round(1e6 * period_s), 1_000_000
        self._call(f"cannot keep {1.0 / period_s:g} Hz", abi.VIDIOC_S_PARM, parm)

    def _buffer(self, index: int) -> abi.Buffer:
        return buffer_of(abi.BUF_TYPE_VIDEO_OUTPUT, index)
