"""Pictures under one light after the other, from fresh frames, and how each came about.

The light is done with once a frame has been exposed, which is before the frame arrives. So where it
is known when that is going to be, the next light is switched on then, and the frame's own time
stamp must bear it out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from capture.sets.metadata import ImageRecord
from rig import Rig, Switch

from .frame_mean import FrameMean
from .fresh_frames import FrameBeat, FreshFrames

__all__ = ["LightImage", "images_under"]

LightImage = tuple[npt.NDArray[np.uint16], ImageRecord]


def images_under(
    rig: Rig, lights: Sequence[int | None], average: int, beat: FrameBeat
) -> list[LightImage]:
    """Switch to each light (None: all off) in turn, and take the mean of `average` fresh frames.

    After the exposure of each frame the controller is asked whether that light is still the one
    that is lit. The mean of several frames is stretched to 16 bits. The last light stays on.

    Raises
    ------
    SetRejected
        If no fresh frame comes.
    HardwareError
        If the controller or the camera fails.
    """
    images = []
    switch = _switched(rig, lights[0])
    for number, light in enumerate(lights):
        turn = _Turn(rig, light, switch, average, beat)
        if number + 1 < len(lights):
            switch = turn.ended_by_switch_to(lights[number + 1])
        else:
            turn.end()
        images.append(turn.image())
    return images


class _Turn:
    """The turn of one light, which begins with the switch to it."""

    def __init__(
        self, rig: Rig, light: int | None, switch: Switch, average: int, beat: FrameBeat
    ) -> None:
        self._rig = rig
        self._light = light
        self._average = average
        self._beat = beat
        self._begin(switch)

    def ended_by_switch_to(self, light: int | None) -> Switch:
        """Take the frames, and switch to the next light as soon as the last one is exposed."""
        self._take(self._average - 1)
        end_s = self._fresh.next_end_s()
        if end_s is not None:
            clock = self._rig.clock
            clock.sleep_s(end_s - clock.now_s())
            asked_s = clock.now_s()
            self._confirm()
            switch = _switched(self._rig, light)
            frame = self._fresh.take_exposed_by(asked_s)
            if frame is not None:
                self._mean.add(frame)
                return switch
            # It came later than was foreseen, so the next light may be in it.
            self._begin(_switched(self._rig, self._light))
        self.end()
        return _switched(self._rig, light)

    def end(self) -> None:
        """Take the frames that are missing, each to its arrival."""
        self._take(self._average - len(self._mean.records))

    def image(self) -> LightImage:
        """The image, and the record of how it came about."""
        fresh, switch = self._fresh, self._switch
        record = ImageRecord(
            light=self._light,
            frames=self._mean.records,
            led_acknowledged_s=switch.acknowledged_s,
            led_level_percent=self._level_percent,
            controller_time_us=switch.controller_time_us,
            stale_frames=fresh.stale,
            corrupt_frames=fresh.corrupt,
            repeated_frames=fresh.repeated,
            lost_frames=fresh.lost,
        )
        return self._mean.image(), record

    def _begin(self, switch: Switch) -> None:
        self._switch = switch
        self._level_percent: int | None = None
        self._fresh = FreshFrames(self._rig, self._light, switch, self._beat)
        self._mean = FrameMean(self._rig.camera.info, self._average)

    def _take(self, frames: int) -> None:
        for _ in range(frames):
            self._mean.add(self._fresh.take())
            self._confirm()

    def _confirm(self) -> None:
        """Ask after an exposure: a watchdog that tripped or a restart in it shows here."""
        state = self._rig.lights.confirm(self._light)
        if self._light is not None:
            self._level_percent = state.levels_percent[self._light]


def _switched(rig: Rig, light: int | None) -> Switch:
    return rig.lights.off() if light is None else rig.lights.select(light)
