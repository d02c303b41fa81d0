"""Open a video device, ask its driver, and say in words what went wrong."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os

from rig.errors import CameraError

__all__ = ["ask", "explained", "open_node"]


def open_node(path: str) -> int:
    """The descriptor of a video device, on which nothing waits without an end.

    Raises
    ------
    CameraError
        If it is missing or not permitted.
    """
    try:
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise CameraError(f"{path}: {_open_cause(error)}") from error


def ask(fd: int, request: int, argument: ctypes._CData) -> None:
    """One ioctl, again if a signal came in between; may raise OSError."""
    while True:
        try:
            fcntl.ioctl(fd, request, argument, True)
        except InterruptedError:
            continue
        return


def explained(path: str, purpose: str, error: OSError) -> CameraError:
    """The `CameraError` that an OSError of a device means; it names the device and the purpose."""
    if error.errno in (errno.ENODEV, errno.ENXIO):
        cause = "the camera is gone (unplugged, or its driver was removed)"
    elif error.errno == errno.EBUSY:
        cause = f"{purpose}: in use by another program; close it and try again"
    elif error.errno == errno.ENOSPC:
        cause = (
            f"{purpose}: no USB bandwidth left; lower the frame rate or the size, or give the "
            "camera a USB controller of its own"
        )
    else:
        cause = f"{purpose}: {error.strerror}"
    return CameraError(f"{path}: {cause}")


def _open_cause(error: OSError) -> str:
    if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return "no such camera; ls /dev/v4l/by-id shows those that are plugged in"
    if error.errno in (errno.EACCES, errno.EPERM):
        return "no permission; add the user to the group video and log in again"
    if error.errno == errno.EBUSY:
        return "in use by another program; close it and try again"
    return f"cannot be opened: {error.strerror}"
