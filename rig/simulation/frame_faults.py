"""Faults in the frames of a simulated camera, on purpose and before any program reads them."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_sim import Clock
from rig.camera import Camera, CameraInfo, Frame, Pixels
from rig.config.fault_plan import MOST_FRAMES_BACK, FrameFault
from rig.errors import CameraError

__all__ = ["FaultyCamera"]


class FaultyCamera:
    """A camera with faulty frames.

    Parameters
    ----------
    camera, clock
        The camera without faults, and the rig's clock.
    faults
        All of them apply to a frame, one after the other.
    seed
        Of the faults' probabilities.
    """

    def __init__(
        self, camera: Camera, clock: Clock, faults: Sequence[FrameFault], seed: int
    ) -> None:
        self._camera = camera
        self._clock = clock
        self._faults = faults
        self._seed = seed
        self._rng = random.Random(seed)
        self._started_s = clock.now_s()
        self._counts = [0] * len(faults)
        self._gone = False
        self._before: deque[Frame] = deque(maxlen=MOST_FRAMES_BACK)
        self._again: Frame | None = None

    @property
    def info(self) -> CameraInfo:
        """The camera's."""
        return self._camera.info

    def read(self, timeout_s: float) -> Frame:
        """The next frame that no fault drops."""
        if self._again is not None:
            frame, self._again = self._again, None
            return frame
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            frame = self._camera.read(max(0.0, deadline_s - self._clock.now_s()))
            kept = self._faulty(frame)
            # Faults repeat what the sensor saw, not the result of earlier faults.
            self._before.append(frame)
            if kept is not None:
                return kept

    def close(self) -> None:
        """Close the camera."""
        self._camera.close()

    def _faulty(self, frame: Frame) -> Frame | None:
        since_s = frame.exposure_start_s - self._started_s
        result = frame
        for index, fault in enumerate(self._faults):
            if self._gone or not fault.when.covers(since_s):
                continue
            self._counts[index] += 1
            if not fault.when.befalls(self._counts[index], self._rng):
                continue
            if fault.kind == "gone":
                self._gone = True
            elif fault.kind == "dropped":
                return None
            elif fault.kind == "late":
                self._clock.sleep_s(fault.delay_ms / 1000.0)
            elif fault.kind == "repeated_frame":
                self._again = result
            else:
                result = _DAMAGE[fault.kind](self, fault, result)
        if self._gone:
            raise CameraError("the camera is gone; check its cable")
        return result

    def _torn(self, fault: FrameFault, frame: Frame) -> Frame:
        if len(self._before) < fault.frames_back:
            return frame
        row = round(fault.row_share * len(frame.pixels))
        pixels = frame.pixels.copy()
        pixels[row:] = self._before[-fault.frames_back].pixels[row:]
        return replace(frame, pixels=pixels)

    def _repeated_pixels(self, _fault: FrameFault, frame: Frame) -> Frame:
        return replace(frame, pixels=self._before[-1].pixels) if self._before else frame

    def _black(self, _fault: FrameFault, frame: Frame) -> Frame:
        return replace(frame, pixels=np.zeros_like(frame.pixels))

    def _dark(self, _fault: FrameFault, frame: Frame) -> Frame:
        info = self.info
        rng = np.random.default_rng((self._seed, frame.sequence))
        noise = (info.read_noise_dn or 0.0) * rng.standard_normal(frame.pixels.shape)
        return replace(frame, pixels=_digital(noise + (info.black_level_dn or 0.0), frame))

    def _stamped_late(self, fault: FrameFault, frame: Frame) -> Frame:
        return frame.shifted(fault.delay_ms / 1e3)

    def _drift(self, fault: FrameFault, frame: Frame) -> Frame:
        since_s = frame.exposure_start_s - self._started_s - fault.when.from_s
        black = self.info.black_level_dn or 0.0
        gain = max(0.0, 1.0 + fault.rate_per_s * since_s)
        return replace(frame, pixels=_digital(black + gain * (frame.pixels - black), frame))


def _digital(values: npt.NDArray[np.floating[Any]], frame: Frame) -> Pixels:
    whole = np.clip(np.rint(values), 0, (1 << frame.bit_depth) - 1)
    pixels: Pixels = whole.astype(np.uint8 if frame.bit_depth == 8 else np.uint16)
    return pixels


_DAMAGE: dict[str, Callable[[FaultyCamera, FrameFault, Frame], Frame]] = {
    "torn": FaultyCamera._torn,
    "repeated_pixels": FaultyCamera._repeated_pixels,
    "black": FaultyCamera._black,
    "dark": FaultyCamera._dark,
    "stamped_late": FaultyCamera._stamped_late,
    "drift": FaultyCamera._drift,
}
