"""Checks of the cameras of this machine, and of the frames of the rig's camera."""

from collections.abc import Iterator, Sequence

from rig.cameras.camera import Camera, CameraInfo, Frame, FrameFlag, ListedCamera
from rig.cameras.config import CameraConfig, DeviceCameraConfig
from rig.cameras.kinds import CAMERA_KINDS
from rig.errors import CameraError, ControlError

from .check import Check
from .light_controller import check_access

# Frames that are read for the rate and the losses; as few as 3 if more would take longer than this.
_FRAMES, _FRAMES_TAKE_S = 30, 10.0
_READ_TIMEOUT_S = 2.0  # on top of a frame period, for a camera that has just started to stream
# 30 frames whose first and last stamp jitter by half a period give the rate to 3 %.
_RATE_TOLERANCE = 0.05
_MOST_FORMATS = 6  # limit of one line of the report


def check_cameras(cameras: Sequence[ListedCamera], config: CameraConfig | None) -> Iterator[Check]:
    """Check each camera of this machine, and the permission for the rig's own."""
    for camera in cameras:
        if camera.problem is not None:
            yield Check("camera", "warning", camera.problem)
            continue
        formats = ", ".join(camera.formats[:_MOST_FORMATS])
        more = len(camera.formats) - _MOST_FORMATS
        more_formats = f" and {more} more formats" if more > 0 else ""
        finding = f"{camera.name} ({camera.driver}) at {camera.device}: {formats}{more_formats}"
        yield Check("camera", "ok", finding)
    if isinstance(config, DeviceCameraConfig):
        own = next((camera for camera in cameras if config.matches(camera)), None)
        if own is not None and own.node is not None:
            yield check_access("permission", str(own.node))
        elif own is None:
            finding = f"{config.device} is not among the {len(cameras)} cameras found"
            advice = "is it plugged in? Set camera.device to one of the names above"
            yield Check("camera.device", "fault", finding, advice)


def check_controls(error: ControlError) -> Iterator[Check]:
    """Report each control that prevents a camera from being opened as one fault."""
    for fault in error.faults:
        yield Check(f"control {fault.control}", "fault", fault.seen, fault.advice)


def check_frames(camera: Camera) -> Iterator[Check]:
    """Check the frame rate and what the camera's kind needs; count lost and corrupt frames."""
    info = camera.info
    yield from _check_kind(info)
    frames = max(3, min(_FRAMES, round(_FRAMES_TAKE_S / info.frame_period_s)))
    read_frames: list[Frame] = []
    # Frames that waited in the queue do not show the rate.
    for number in range(info.queue_length + frames):
        frame = camera.read(_READ_TIMEOUT_S + info.frame_period_s)
        if number >= info.queue_length:
            read_frames.append(frame)
    steps = read_frames[-1].sequence - read_frames[0].sequence
    elapsed_s = read_frames[-1].exposure_start_s - read_frames[0].exposure_start_s
    if steps <= 0 or elapsed_s <= 0.0:
        numbers = f"{read_frames[0].sequence} to {read_frames[-1].sequence}"
        raise CameraError(
            f"{frames} frames from number {numbers} in {elapsed_s:.3f} s: the camera's numbers or "
            "time stamps do not advance"
        )
    rate_hz, asked_hz = steps / elapsed_s, 1.0 / info.frame_period_s
    finding = f"{rate_hz:.2f} Hz reached, {asked_hz:.2f} Hz asked for"
    if abs(rate_hz / asked_hz - 1.0) <= _RATE_TOLERANCE:
        yield Check("frame rate", "ok", finding)
    else:
        advice = (
            "set camera.frame_rate_hz to the rate reached; an exposure longer than a frame, a "
            "dynamic frame rate in dim light, or a full USB bus slows a camera down"
        )
        yield Check("frame rate", "warning", finding, advice)
    lost = steps + 1 - len(read_frames)
    corrupt = sum(frame.flags != FrameFlag.GOOD for frame in read_frames)
    finding = f"{lost} lost and {corrupt} corrupt of {steps + 1}"
    if lost == 0 and corrupt == 0:
        yield Check("frames", "ok", finding)
    else:
        advice = "give the camera its own USB port, a shorter cable, or a lower frame rate"
        yield Check("frames", "warning", finding, advice)


def _check_kind(info: CameraInfo) -> Iterator[Check]:
    """Check what an open camera needs beside it, such as a network."""
    faults = CAMERA_KINDS[info.kind].faults
    if faults is not None:
        yield from (
            Check(fault.control, "warning", fault.seen, fault.advice) for fault in faults(info)
        )


def exposure_range_ms(
    camera: Camera, listed: Sequence[ListedCamera], config: CameraConfig
) -> tuple[float, float]:
    """The shortest and the longest exposure in ms; that of OpenCV's cameras comes from `listed`."""
    shortest_ms, longest_ms = camera.exposure_range_ms
    if not isinstance(config, DeviceCameraConfig):
        return shortest_ms, longest_ms
    limits = [
        entry.longest_exposure_ms
        for entry in listed
        if entry.longest_exposure_ms is not None and config.matches(entry)
    ]
    return shortest_ms, max(shortest_ms, min([longest_ms, *limits]))
