"""The picture under one light, from fresh frames, and the record of how it came about."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rig import Rig

from .fresh_frames import FrameBeat, FreshFrames
from .set_metadata import FrameRecord, ImageRecord

__all__ = ["image_under"]


def image_under(
    rig: Rig, light: int | None, average: int, beat: FrameBeat
) -> tuple[npt.NDArray[np.uint16], ImageRecord]:
    """Switch to `light` (None: all off) and take the mean of `average` fresh frames.

    After each frame the controller is asked whether that light is still the one that is lit. The
    mean of several frames is stretched to 16 bits.

    Raises
    ------
    SetRejected
        If no fresh frame comes.
    HardwareError
        If the controller or the camera fails.
    """
    switch = rig.lights.off() if light is None else rig.lights.select(light)
    fresh = FreshFrames(rig, light, switch, beat)
    frames: list[FrameRecord] = []
    info = rig.camera.info
    total = np.zeros((info.height_px, info.width_px), dtype=np.uint32)
    saturated = np.zeros(total.shape, dtype=np.bool_)
    for _ in range(average):
        frame = fresh.take()
        # Asked after the exposure: a watchdog that tripped or a restart in it shows here.
        state = rig.lights.confirm(light)
        frames.append(
            FrameRecord(
                sequence=frame.sequence,
                exposure_start_s=frame.exposure_start_s,
                exposure_end_s=frame.exposure_end_s,
            )
        )
        if average == 1:
            image = frame.pixels.astype(np.uint16)
        else:
            total += frame.pixels
            saturated |= frame.pixels >= (1 << info.bit_depth) - 1
    if average > 1:
        scale = 65535.0 / (((1 << info.bit_depth) - 1) * average)
        image = np.rint(total * scale).astype(np.uint16)
        # A pixel that saturated once has no mean.
        image[saturated] = 65535
    record = ImageRecord(
        light=light,
        frames=tuple(frames),
        led_acknowledged_s=switch.acknowledged_s,
        led_level_percent=None if light is None else state.levels_percent[light],
        controller_time_us=switch.controller_time_us,
        stale_frames=fresh.stale,
        corrupt_frames=fresh.corrupt,
        repeated_frames=fresh.repeated,
        lost_frames=fresh.lost,
    )
    return image, record
