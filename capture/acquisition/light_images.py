"""The picture under one light, from fresh frames, and the record of how it came about."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from capture.sets.metadata import ImageRecord
from rig import Rig

from .frame_mean import FrameMean
from .fresh_frames import FrameBeat, FreshFrames

__all__ = ["LightImage", "image_under"]

LightImage = tuple[npt.NDArray[np.uint16], ImageRecord]


def image_under(rig: Rig, light: int | None, average: int, beat: FrameBeat) -> LightImage:
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
    mean = FrameMean(rig.camera.info, average)
    for _ in range(average):
        mean.add(fresh.take())
        # Asked after the exposure: a watchdog that tripped or a restart in it shows here.
        state = rig.lights.confirm(light)
    record = ImageRecord(
        light=light,
        frames=mean.records,
        led_acknowledged_s=switch.acknowledged_s,
        led_level_percent=None if light is None else state.levels_percent[light],
        controller_time_us=switch.controller_time_us,
        stale_frames=fresh.stale,
        corrupt_frames=fresh.corrupt,
        repeated_frames=fresh.repeated,
        lost_frames=fresh.lost,
    )
    return mean.image(), record
