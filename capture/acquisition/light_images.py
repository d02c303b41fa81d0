"""Capture light images one after the other, with the lights switched by this computer.

An LED is no longer needed once its frame is exposed, which is before the frame arrives. Where the
end of exposure can be predicted, the next light is switched on at that time, and the time stamp of
the frame must confirm the prediction.
"""

from collections.abc import Callable, Sequence

from capture.sets.metadata import ImageRecord
from rig import Rig, Switch
from rig.fresh_frame import FrameKind, switch_to

from .frame_mean import FrameMean, SetImage
from .fresh_frames import FrameHistory, FreshFrames


def images_under(
    rig: Rig,
    lights: Sequence[int | None],
    average: int,
    history: FrameHistory,
    arrived: Callable[[SetImage], None] = lambda _: None,
) -> list[SetImage]:
    """Capture one image under each light (None: all LEDs off); the last light stays on.

    `arrived` is given each image while the next one is exposed, and must return at once.
    """
    slot = _LightSlot(rig, lights[0], switch_to(rig, lights[0]), average, history)
    images = []
    for light in lights[1:]:
        switch = slot.end_with_switch_to(light)
        images.append(slot.image())
        slot = _LightSlot(rig, light, switch, average, history)
        arrived(images[-1])
    slot.end()
    images.append(slot.image())
    arrived(images[-1])
    return images


class _LightSlot:
    """The time in which one light is on, from its switch."""

    def __init__(
        self, rig: Rig, light: int | None, switch: Switch, average: int, history: FrameHistory
    ) -> None:
        self._rig = rig
        self._light = light
        self._average = average
        self._history = history
        self._begin(switch)

    def end_with_switch_to(self, light: int | None) -> Switch:
        """Take the frames, and switch to the next light as soon as the last one is exposed."""
        self._take(self._average - 1)
        end_s = self._fresh.next_end_s()
        if end_s is not None:
            clock = self._rig.clock
            clock.sleep_s(end_s - clock.now_s())
            asked_s = clock.now_s()
            self._confirm()
            switch = switch_to(self._rig, light)
            frame = self._fresh.take_exposed_by(asked_s)
            if frame is not None:
                self._mean.add(frame)
                return switch
            # The frame came later than predicted, so it may show the next light.
            self._begin(switch_to(self._rig, self._light))
        self.end()
        return switch_to(self._rig, light)

    def end(self) -> None:
        """Wait for the frames that are still missing."""
        self._take(self._average - len(self._mean.records))

    def image(self) -> SetImage:
        fresh, switch = self._fresh, self._switch
        record = ImageRecord(
            light=self._light,
            frames=self._mean.records,
            led_acknowledged_s=switch.acknowledged_s,
            led_level_percent=self._level_percent,
            controller_time_us=switch.controller_time_us,
            stale_frames=fresh.counts[FrameKind.STALE],
            corrupt_frames=fresh.counts[FrameKind.CORRUPT],
            repeated_frames=fresh.counts[FrameKind.REPEATED],
            lost_frames=fresh.lost,
        )
        return SetImage(self._mean.image(), record)

    def _begin(self, switch: Switch) -> None:
        self._switch = switch
        self._level_percent: int | None = None
        self._fresh = FreshFrames(self._rig, self._light, switch, self._history)
        self._mean = FrameMean(self._rig.camera.info, self._average)

    def _take(self, frames: int) -> None:
        for _ in range(frames):
            self._mean.add(self._fresh.take())
            self._confirm()

    def _confirm(self) -> None:
        """Ask for the light after an exposure, to notice a watchdog or restart during it."""
        state = self._rig.lights.confirm(self._light)
        if self._light is not None:
            self._level_percent = state.levels_percent[self._light]
