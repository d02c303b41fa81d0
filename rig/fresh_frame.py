"""Frames that show a change of the lights: those that began after it, among all that come."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from .camera import Frame, FrameFlag
from .errors import CameraError
from .rig import Rig

__all__ = ["frames_until", "fresh_frame"]

# Beyond what the frame rate and the driver's queue explain.
_SPARE_S = 2.0


def fresh_frame(rig: Rig, light: int | None) -> Frame:
    """Switch to `light` (None: all off) and take the first good frame that began under it.

    This is for looking at a rig. What is measured with has more to hold, see `capture_set`.

    Raises
    ------
    HardwareError
        If the controller or the camera fails, or no such frame comes.
    """
    switch = rig.lights.off() if light is None else rig.lights.select(light)
    settled_s = switch.acknowledged_s + rig.config.lights.settle_ms / 1e3
    (frame,) = deque(frames_until(rig, settled_s), maxlen=1)  # the last
    rig.lights.confirm(light)
    return frame


def frames_until(rig: Rig, begun_s: float) -> Iterator[Frame]:
    """All good frames up to the first that is said to have begun at `begun_s` or later.

    Raises
    ------
    CameraError
        If that does not come in the time that the queue and the frame rate account for.
    """
    info, now_s = rig.camera.info, rig.clock.now_s()
    patience_s = (
        max(begun_s - now_s, 0.0)
        + (info.queue_length + 3) * info.frame_period_s
        + info.exposure_s
        + _SPARE_S
    )
    came = corrupt = 0
    while rig.clock.now_s() < now_s + patience_s:
        # Not only what remains: a camera that gives old frames has not failed to give any.
        frame = rig.camera.read(patience_s)
        came += 1
        if frame.flags != FrameFlag.GOOD:
            corrupt += 1
            continue
        yield frame
        if frame.exposure_start_s >= begun_s:
            return
    raise CameraError(
        f"{came} frames came in {patience_s:.1f} s after a switch of the lights, {corrupt} of them "
        "corrupt, and none of the good ones began after it, by its time stamp; ps4rig rig latency "
        "finds out what the stamps mean, unless they are not on the rig's clock"
    )
