"""A V4L2 loopback device, which other programs read as a camera."""

import ctypes
import mmap
from typing import ClassVar

from classify.base.errors import ConfigError
from rig.cameras.config import CameraConfig
from rig.cameras.served import FrameSource
from rig.errors import CameraError

from . import abi
from .device import VideoNode
from .measurement_mode import V4l2CameraConfig
from .pixel_formats import PIXEL_FORMATS, PixelFormat

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
        required = abi.Cap.VIDEO_OUTPUT | abi.Cap.STREAMING
        if capability.device_caps & required != required:
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
        requested = f"{fourcc.strip()} {width_px}x{height_px}"
        self.call(f"does not take {requested}", abi.Vidioc.S_FMT, form)
        actual = (abi.fourcc_text(pix.pixelformat), pix.width, pix.height)
        if actual == (fourcc, width_px, height_px) and pix.bytesperline != bytes_per_line:
            # v4l2loopback treats Y10 and Y12 as packed, so that its buffers are too small.
            raise CameraError(
                f"{self.path}: for {requested} the driver has {pix.bytesperline} bytes a line, "
                f"not {bytes_per_line}; set camera.pixel_format to GREY or Y16"
            )
        if actual != (fourcc, width_px, height_px):
            raise CameraError(
                f"{self.path}: {requested} was asked for, the driver gave "
                f"{actual[0].strip()} {pix.width}x{pix.height}; close programs that read the device"
            )

    def _set_period(self, period_s: float) -> None:
        parm = abi.StreamParm(type=abi.BufType.VIDEO_OUTPUT)
        interval = parm.parm.capture.timeperframe
        interval.numerator, interval.denominator = round(1e6 * period_s), 1_000_000
        self.call(f"cannot keep {1.0 / period_s:g} Hz", abi.Vidioc.S_PARM, parm)


# Frames later than this many periods are skipped, so that no burst follows a delay.
_MAX_LATE_PERIODS = 1.0


class LoopbackCamera:
    """A loopback device with frames at the configured rate; it has no exposure control."""

    place_help: ClassVar[str] = "DEV, of v4l2loopback (modprobe v4l2loopback makes one)"

    def __init__(self, place: str, config: CameraConfig) -> None:
        self._place = place
        self._config = config
        self._format = _writable_format(config)
        self.pixel_format, self.bit_depth = self._format.name, self._format.bit_depth

    def start(self, source: FrameSource) -> None:
        config = self._config
        self._source = source
        self._output = V4l2Output(
            self._place,
            fourcc=self._format.fourcc,
            width_px=config.width_px,
            height_px=config.height_px,
            bytes_per_line=config.width_px * self._format.bytes_per_px,
            period_s=1.0 / config.frame_rate_hz,
        )

    def step(self) -> None:
        frame = self._source.next_frame(_MAX_LATE_PERIODS)
        if frame is not None:
            assert self._format.to_bytes is not None
            self._output.write(self._format.to_bytes(frame.pixels), frame.end_s)

    def close(self) -> None:
        self._output.close()


def _writable_format(config: CameraConfig) -> PixelFormat:
    if not isinstance(config, V4l2CameraConfig):
        return PIXEL_FORMATS["GREY" if config.bits == 8 else "Y16"]
    form = PIXEL_FORMATS[config.pixel_format]
    if form.to_bytes is None:
        writable = (name for name, known in PIXEL_FORMATS.items() if known.to_bytes is not None)
        raise ConfigError(
            f"camera.pixel_format = {config.pixel_format!r} cannot be written; it can be "
            + ", ".join(writable)
        )
    return form
