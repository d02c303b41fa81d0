"""A driver's buffers, reserved for one stream and mapped into our memory."""

from __future__ import annotations

import mmap

from rig.errors import CameraError

from . import abi
from .ioctl import ask, explained

__all__ = ["buffer_of", "claim_buffers"]


def buffer_of(stream: int, index: int) -> abi.Buffer:
    """What a driver is asked about one buffer with; `stream` is a ``BUF_TYPE``."""
    return abi.Buffer(index=index, type=stream, memory=abi.MEMORY_MMAP)


def claim_buffers(fd: int, path: str, stream: int, count: int) -> dict[int, mmap.mmap]:
    """Reserve `count` buffers, or as many as the driver has, so that no other program can stream.

    Returns
    -------
    The memory of each by its offset, in the order of their indices.

    Raises
    ------
    CameraError
        If the driver has none, or they cannot be mapped.
    """
    request = abi.RequestBuffers(count=count, type=stream, memory=abi.MEMORY_MMAP)
    try:
        ask(fd, abi.VIDIOC_REQBUFS, request)
    except OSError as error:
        raise explained(path, "has no buffers for us", error) from error
    mapped: dict[int, mmap.mmap] = {}
    try:
        for index in range(request.count):
            buffer = buffer_of(stream, index)
            ask(fd, abi.VIDIOC_QUERYBUF, buffer)
            mapped[buffer.m.offset] = mmap.mmap(fd, buffer.length, offset=buffer.m.offset)
    except OSError as error:
        for memory in mapped.values():
            memory.close()
        raise explained(path, "its buffers cannot be mapped", error) from error
    if not mapped:
        raise CameraError(f"{path}: the driver has no buffers for us")
    return mapped
