"""Injected faults in the frames of a simulated camera."""

import random
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from firmware_sim import Clock
from rig.cameras.camera import Camera, CameraInfo, Frame
from rig.config.simulation import MAX_FRAMES_BACK, FrameFault
from rig.errors import CameraError

from .sensor import quantised


class FaultyCamera:
    """A camera whose frames have the faults of a plan, one after the other."""

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
        self._is_gone = False
        self._earlier_frames: deque[Frame] = deque(maxlen=MAX_FRAMES_BACK)
        self._repeated_frame: Frame | None = None

    @property
    def info(self) -> CameraInfo:
        return self._camera.info

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        return self._camera.exposure_range_ms

    def set_exposure(self, exposure_ms: float) -> None:
        self._camera.set_exposure(exposure_ms)

    def read(self, timeout_s: float) -> Frame:
        """The next frame that no fault drops."""
        if self._repeated_frame is not None:
            frame, self._repeated_frame = self._repeated_frame, None
            return frame
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            frame = self._camera.read(max(0.0, deadline_s - self._clock.now_s()))
            delivered = self._with_faults(frame)
            # Faults repeat what the sensor saw, not the result of earlier faults.
            self._earlier_frames.append(frame)
            if delivered is not None:
                return delivered

    def close(self) -> None:
        self._camera.close()

    def _with_faults(self, frame: Frame) -> Frame | None:
        """Return the frame as it is delivered, or None if it is dropped."""
        elapsed_s = frame.exposure_start_s - self._started_s
        result, repeated = frame, None
        for index, fault in enumerate(self._faults):
            if self._is_gone or not fault.when.covers(elapsed_s):
                continue
            self._counts[index] += 1
            if not fault.when.affects(self._counts[index], self._rng):
                continue
            if fault.kind == "gone":
                self._is_gone = True
            elif fault.kind == "dropped":
                return None
            elif fault.kind == "late":
                self._clock.sleep_s(fault.delay_ms / 1000.0)
            elif fault.kind == "repeated_frame":
                repeated = result
            else:
                result = self._damaged(fault, result)
        if self._is_gone:
            raise CameraError("the camera is gone; check its cable")
        self._repeated_frame = repeated
        return result

    def _damaged(self, fault: FrameFault, frame: Frame) -> Frame:
        if fault.kind == "stamped_late":
            return frame.shifted(fault.delay_ms / 1e3)
        pixels, black = frame.pixels, self.info.black_level_dn or 0.0
        if fault.kind == "torn" and len(self._earlier_frames) >= fault.frames_back:
            row = round(fault.row_share * len(pixels))
            pixels = pixels.copy()
            pixels[row:] = self._earlier_frames[-fault.frames_back].pixels[row:]
        elif fault.kind == "repeated_pixels" and self._earlier_frames:
            pixels = self._earlier_frames[-1].pixels
        elif fault.kind == "black":
            pixels = np.zeros_like(pixels)
        elif fault.kind == "dark":
            rng = np.random.default_rng((self._seed, frame.sequence))
            noise = (self.info.read_noise_dn or 0.0) * rng.standard_normal(pixels.shape)
            pixels = quantised(noise + black, frame.bit_depth)
        elif fault.kind == "drift":
            drifting_s = frame.exposure_start_s - self._started_s - fault.when.from_s
            gain = max(0.0, 1.0 + fault.rate_per_s * drifting_s)
            pixels = quantised(black + gain * (pixels - black), frame.bit_depth)
        return replace(frame, pixels=pixels)
