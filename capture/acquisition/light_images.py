"""Capture light images one after the other, with the lights switched by this computer.

An image is one frame, or the mean of several stretched to 16 bits.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from capture.sets.metadata import FrameRecord, ImageRecord
from rig import CameraInfo, Frame, Rig, Switch
from rig.fresh_frame import FrameKind, switch_to

from .fresh_frames import FrameHistory, FreshFrames


@dataclass(frozen=True, eq=False)
class SetImage:
    """A light image or an ambient image, (H, W) uint16, and the record of its capture."""

    pixels: npt.NDArray[np.uint16]
    record: ImageRecord


class FrameMean:
    """Mean of `count` frames, which are added one by one; a single frame stays unchanged."""

    def __init__(self, info: CameraInfo, count: int) -> None:
        self._full_scale = (1 << info.bit_depth) - 1
        self._count = count
        if count > 1:
            shape = (info.height_px, info.width_px)
            self._total = np.zeros(shape, np.uint32)
            self._saturated = np.zeros(shape, np.bool_)
        self.records: tuple[FrameRecord, ...] = ()

    def add(self, frame: Frame) -> None:
        if self._count == 1:
            # A copy takes a fifth of the time of a sum.
            self._single = frame.pixels.astype(np.uint16)
        else:
            self._total += frame.pixels
            self._saturated |= frame.pixels >= self._full_scale
        record = FrameRecord(
            sequence=frame.sequence,
            exposure_start_s=frame.exposure_start_s,
            exposure_end_s=frame.exposure_end_s,
        )
        self.records = (*self.records, record)

    def image(self) -> npt.NDArray[np.uint16]:
        """The mean, (H, W); that of several frames is stretched to 65535."""
        if self._count == 1:
            return self._single
        scale = 65535.0 / (self._full_scale * self._count)
        mean: npt.NDArray[np.uint16] = np.rint(self._total * scale).astype(np.uint16)
        # The mean of a pixel that was saturated in any frame is unknown.
        mean[self._saturated] = 65535
        return mean


def images_under(
    rig: Rig,
    lights: Sequence[int | None],
    average: int,
    history: FrameHistory,
    on_image: Callable[[SetImage], None] = lambda _: None,
) -> list[SetImage]:
    """Capture an image under each light (None: all off); the last light stays on.

    `on_image` gets every image, and must return at once.
    """
    slot = _LightSlot(rig, lights[0], switch_to(rig, lights[0]), average, history)
    images = []
    for light in lights[1:]:
        switch = slot.end_with_switch_to(light)
        images.append(slot.image())
        slot = _LightSlot(rig, light, switch, average, history)
        on_image(images[-1])
    slot.end()
    images.append(slot.image())
    on_image(images[-1])
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
            commanded_s = clock.now_s()
            self._confirm()
            switch = switch_to(self._rig, light)
            frame = self._fresh.take_exposed_by(commanded_s)
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
            lost_frames=fresh.lost_frames,
        )
        return SetImage(self._mean.image(), record)

    def _begin(self, switch: Switch) -> None:
        self._switch = switch
        self._level_percent: int | None = None
        self._fresh = FreshFrames(self._rig, self._light, switch, self._history)
        self._mean = FrameMean(self._rig.camera.info, self._average)

    def _take(self, count: int) -> None:
        for _ in range(count):
            self._mean.add(self._fresh.take())
            self._confirm()

    def _confirm(self) -> None:
        """Check after an exposure that no watchdog or restart has put the light out."""
        state = self._rig.lights.confirm(self._light)
        if self._light is not None:
            self._level_percent = state.levels_percent[self._light]
