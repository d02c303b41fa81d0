"""Write frames into a V4L2 loopback device, which other programs read as a camera."""

import ctypes
import mmap

from rig.errors import CameraError

from . import abi
from .device import VideoNode

# Enough to write one buffer while others are read; the driver may have fewer.
_BUFFERS = 4


class V4l2Output(VideoNode):
    """A loopback device, open for writing; a frame keeps the time stamp that it is given here."""

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
        super().__init__(path, abi.BufType.VIDEO_OUTPUT)
        try:
            self._claim()
            self._set_format(fourcc, width_px, height_px, bytes_per_line)
            self._set_period(period_s)
            self._maps = self.map_buffers(_BUFFERS)
            kind = ctypes.c_int32(abi.BufType.VIDEO_OUTPUT)
            self.call("takes no stream", abi.Vidioc.STREAMON, kind)
        except BaseException:
            self.close()
            raise

    def write(self, frame: bytes, timestamp_s: float) -> None:
        """Hand a frame to the readers; `timestamp_s` is its end on the monotonic clock."""
        if len(frame) != self._frame_bytes:
            raise ValueError(f"a frame of {len(frame)} bytes instead of {self._frame_bytes}")
        buffer = self.buffer(self._written % len(self._maps))
        # Queried each time: a reader that claims fewer buffers moves the existing ones.
        self.call("has lost a buffer", abi.Vidioc.QUERYBUF, buffer)
        self._maps[buffer.m.offset][: len(frame)] = frame
        buffer.bytesused = len(frame)
        buffer.field = abi.FIELD_NONE
        stamp_us = round(timestamp_s * 1e6)
        buffer.timestamp.tv_sec, buffer.timestamp.tv_usec = divmod(stamp_us, 1_000_000)
        self.call("takes no frame", abi.Vidioc.QBUF, buffer)
        self._written += 1

    def close(self) -> None:
        """End the stream and release the device; a second call does nothing."""
        for mapped in self._maps.values():
            mapped.close()
        self._maps.clear()
        super().close()

    def _claim(self) -> None:
        """Refuse a device that takes no frames, or that another simulated rig writes to."""
        capability = abi.Capability()
        self.call("is no video device", abi.Vidioc.QUERYCAP, capability)
        able = abi.Cap.VIDEO_OUTPUT | abi.Cap.STREAMING
        if capability.device_caps & able != able:
            raise CameraError(
                f"{self.path}: {abi.text(capability.card)} takes no frames; give a loopback "
                "device, which modprobe v4l2loopback makes"
            )
        import fcntl

        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise CameraError(
                f"{self.path}: another simulated rig writes to it; stop that rig"
            ) from error

    def _set_format(self, fourcc: str, width_px: int, height_px: int, bytes_per_line: int) -> None:
        form = abi.Format(type=abi.BufType.VIDEO_OUTPUT)
        pix = form.fmt.pix
        pix.width, pix.height, pix.pixelformat = width_px, height_px, abi.fourcc(fourcc)
        pix.field, pix.bytesperline = abi.FIELD_NONE, bytes_per_line
        asked = f"{fourcc.strip()} {width_px}x{height_px}"
        self.call(f"does not take {asked}", abi.Vidioc.S_FMT, form)
        given = (abi.fourcc_text(pix.pixelformat), pix.width, pix.height)
        if given == (fourcc, width_px, height_px) and pix.bytesperline != bytes_per_line:
            # v4l2loopback treats Y10 and Y12 as packed, so that its buffers are too small.
            raise CameraError(
                f"{self.path}: for {asked} the driver has {pix.bytesperline} bytes a line instead "
                f"of {bytes_per_line}; set camera.pixel_format to GREY or Y16"
            )
        if given != (fourcc, width_px, height_px):
            raise CameraError(
                f"{self.path}: {asked} was asked for, the driver gave "
                f"{given[0].strip()} {pix.width}x{pix.height}; close programs that read the device"
            )

    def _set_period(self, period_s: float) -> None:
        parm = abi.StreamParm(type=abi.BufType.VIDEO_OUTPUT)
        interval = parm.parm.capture.timeperframe
        interval.numerator, interval.denominator = round(1e6 * period_s), 1_000_000
        self.call(f"cannot keep {1.0 / period_s:g} Hz", abi.Vidioc.S_PARM, parm)
