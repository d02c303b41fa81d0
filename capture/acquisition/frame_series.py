"""Frames for the calibration of a camera: lens covered, and exposure ladder."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from capture.base.console import progress
from capture.procedures.camera_parts import Rung, levels_of
from classify import Calibration
from classify.base.arrays import Array
from classify.base.errors import ConfigError
from classify.calibration.dark import DarkFrames, dark_of
from rig import CameraError, Frame, Rig
from rig.cameras.camera import EXPOSURE_LAG_FRAMES, Pixels
from rig.fresh_frame import (
    FRAMES_BESIDES_QUEUE,
    SPARE_S,
    FrameKind,
    fresh_frame,
    kind_of,
    next_fresh_frame,
    switch_to,
)
from rig.signals import signals_held_back

from .fresh_frames import RepeatDetector, check_frame

# Ratios of each exposure to the next shorter one. The first ratios are small, because the highest
# levels constrain the response most. Together they are 63, which reaches the lowest seventh of the
# values of a camera with gamma 2.2.
_RATIOS = (*[1.12] * 6, *[1.25] * 5, *[1.6] * 5)
# Divisor of the exposure while more than half of the frame is saturated.
_EXPOSURE_DIVISOR = 1.4
_MAX_SATURATED_SHARE = 0.5
# Hot pixels deviate by more than the noise of one frame, which the mean of 16 frames suppresses.
_DARK_FRAMES = 16
# Frames at each exposure. Their differences show the noise, with three degrees of freedom.
_LADDER_FRAMES = 4


def dark_of_rig(rig: Rig) -> DarkFrames:
    """Measure frames of a rig with its lens covered; its LEDs must not change them."""
    frames = frame_series(rig, None, _DARK_FRAMES)
    lit = np.concatenate([frame_series(rig, light, 1) for light in range(len(rig.lighting))])
    return dark_of(frames, (1 << rig.camera.info.bit_depth) - 1, lit)


def rungs_of_rig(rig: Rig, calibration: Calibration) -> list[Rung]:
    """Capture a ladder of exposures of a white sheet, with progress; restore the exposure."""
    bit_depth = rig.camera.info.bit_depth
    full_scale = (1 << bit_depth) - 1
    with restored_exposure(rig):
        light = brightest_light(rig)
        exposures_ms = ladder_ms(rig, light)
        rungs = []
        for exposure_ms in progress(exposures_ms, len(exposures_ms), "exposures"):
            frames = frames_at(rig, light, exposure_ms, _LADDER_FRAMES)
            levels = levels_of(frames, full_scale, bit_depth, calibration)
            # A camera rounds the exposure that is set.
            rungs.append(Rung(1e3 * rig.camera.info.exposure_s, levels))
        return rungs


def frame_series(rig: Rig, light: int | None, count: int) -> Pixels:
    """Return (count, H, W) fresh frames under one light, None for all LEDs off; it stays on."""
    repeats = RepeatDetector()

    def classify(frame: Frame, not_before_s: float) -> FrameKind:
        check_frame(frame, rig.camera.info, rig.clock.now_s())
        return FrameKind.REPEATED if repeats.is_repeat(frame) else kind_of(frame, not_before_s)

    switch = switch_to(rig, light)
    settled_s = switch.acknowledged_s + rig.config.lights.settle_ms / 1e3
    frames: list[Array] = [next_fresh_frame(rig, settled_s, classify).pixels for _ in range(count)]
    rig.lights.confirm(light)
    return np.stack(frames)


def require_free_running(rig: Rig) -> None:
    """Raise a `ConfigError` for a camera that exposes at triggers only."""
    if rig.config.lights.synchronisation == "trigger":
        raise ConfigError(
            "lights.synchronisation = 'trigger': the camera gives no frames by itself; set it to "
            "'software' for this calibration, and let the camera run free"
        )


@contextmanager
def restored_exposure(rig: Rig) -> Iterator[None]:
    """Restore the exposure and put the LEDs out at the end, also after an error."""
    configured_ms = 1e3 * rig.camera.info.exposure_s
    try:
        yield
    finally:
        with signals_held_back():
            try:
                rig.lights.off()
            finally:
                rig.camera.set_exposure(configured_ms)


def brightest_light(rig: Rig) -> int:
    """Return the light under which the frame is brightest."""
    means = [float(fresh_frame(rig, light).pixels.mean()) for light in range(len(rig.lighting))]
    return int(np.argmax(means))


def ladder_ms(rig: Rig, light: int) -> list[float]:
    """Return exposures for a response, from one that saturates at most half of the frame down."""
    shortest_ms, longest_ms = rig.camera.exposure_range_ms
    if shortest_ms == longest_ms:
        raise CameraError(
            f"the camera has one exposure only, {longest_ms:g} ms, so that its response cannot be "
            "measured; give sets of other exposures with --from"
        )
    top_ms, full = longest_ms, (1 << rig.camera.info.bit_depth) - 1
    while top_ms > shortest_ms:
        (frame,) = frames_at(rig, light, top_ms, 1)
        if float((frame >= full).mean()) <= _MAX_SATURATED_SHARE:
            break
        top_ms = max(shortest_ms, top_ms / _EXPOSURE_DIVISOR)
    exposures_ms = top_ms / np.cumprod((1.0, *_RATIOS))
    return [exposure_ms for exposure_ms in exposures_ms.tolist() if exposure_ms >= shortest_ms]


def frames_at(rig: Rig, light: int, exposure_ms: float, count: int) -> Pixels:
    """Return (count, H, W) frames under one light at an exposure, which stays set."""
    rig.camera.set_exposure(exposure_ms)
    info = rig.camera.info
    for _ in range(info.queue_length + EXPOSURE_LAG_FRAMES):
        rig.camera.read((info.queue_length + FRAMES_BESIDES_QUEUE) * info.frame_period_s + SPARE_S)
    return frame_series(rig, light, count)
