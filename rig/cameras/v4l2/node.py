"""An open video device node: ioctls, and error messages for them."""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
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

    def call(self, purpose: str, request: int, argument: ctypes._CData) -> None:
        """Do one ioctl; an error becomes a `CameraError` that names the device and the purpose."""
        try:
            self.try_call(request, argument)
        except OSError as error:
            self.fail(purpose, error)

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

    def fail(self, purpose: str, error: OSError) -> NoReturn:
        """Raise the `CameraError` for an OSError of this device."""
        if error.errno in (errno.ENODEV, errno.ENXIO):
            cause = "the camera is gone (unplugged, or its driver was removed)"
        elif error.errno == errno.EBUSY:
            cause = f"{purpose}: in use by another program; close it and try again"
        elif error.errno == errno.ENOSPC:
            cause = (
                f"{purpose}: not enough USB bandwidth; lower the frame rate or the size, or "
                "connect the camera to a separate USB controller"
            )
        else:
            cause = f"{purpose}: {error.strerror}"
        raise CameraError(f"{self.path}: {cause}") from error

    def buffer(self, index: int) -> abi.Buffer:
        """The argument of an ioctl about one buffer."""
        return abi.Buffer(index=index, type=self._stream, memory=abi.MEMORY_MMAP)

    def map_buffers(self, count: int) -> dict[int, mmap.mmap]:
        """Map at most `count` buffers by offset; no other program can stream then."""
        request = abi.RequestBuffers(count=count, type=self._stream, memory=abi.MEMORY_MMAP)
        self.call("provides no buffers", abi.VIDIOC_REQBUFS, request)
        mapped: dict[int, mmap.mmap] = {}
        try:
            for index in range(request.count):
                buffer = self.buffer(index)
                self.try_call(abi.VIDIOC_QUERYBUF, buffer)
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
