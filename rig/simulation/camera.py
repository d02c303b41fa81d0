"""A camera above a simulated scene, with a real driver's exposures, stale buffers and stamps."""

import math
import threading
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from classify.base.arrays import FloatMap
from firmware_sim import Clock, SimulatedBoard
from rig.cameras.camera import CameraInfo, Frame, require_exposure
from rig.cameras.config import ReplayCameraConfig, SimulatedCameraConfig
from rig.config.simulation import SimulationConfig
from rig.errors import CameraError

from .sensor import RecordedPixels, Sensor

TRANSFER_S = 0.004
"""Time from the end of the last row's exposure to the frame in the driver's queue: about that of
1280 x 1024 px of 8 bit over USB 3."""
# How often a program that waits for a frame checks whether one was triggered.
_TRIGGER_POLL_S = 0.001
# A clock that slept until a frame was ready may be early by a rounding error.
_ROUNDING_S = 1e-6
# Least number of starts that are kept for frames that are not read yet: 1,600 sets of five frames.
KEPT_STARTS = 8192

_Strobe = Callable[[bool, float], object]


@dataclass(frozen=True)
class Shutter:
    """Frame period, exposure of each row, and readout from the first row to the last."""

    period_s: float
    exposure_s: float
    readout_s: float = 0.0

    @property
    def all_rows_s(self) -> float:
        """From the start of the first row's exposure to the end of the last row's."""
        return self.exposure_s + self.readout_s

    @property
    def ready_after_s(self) -> float:
        """From the start of the exposure to the frame in the driver's queue."""
        return self.all_rows_s + TRANSFER_S


class Exposures(ABC):
    """The exposures of a camera, numbered from 0; `strobe` gets level and time of each edge."""

    def __init__(self, clock: Clock, shutter: Shutter, strobe: _Strobe = lambda *_: None) -> None:
        self.shutter = shutter
        self._clock = clock
        self.strobe = strobe
        self._open = True
        self._in_progress = 0  # number of exposures; with a rolling shutter they may overlap

    @abstractmethod
    def start_s(self, number: int) -> float:
        """Start of an exposure."""

    @abstractmethod
    def count_started(self, by_s: float) -> int:
        """Number of exposures that start up to `by_s`."""

    def await_start(self, number: int, deadline_s: float) -> bool:
        """Wait for the start of an exposure to be known; return False at the deadline."""
        del number, deadline_s
        return True

    def trigger(self) -> bool:
        """Give a pulse on the trigger line now; return whether it starts an exposure."""
        return False

    def close(self) -> None:
        """Start no further exposure."""
        self._open = False

    def _expose(self, start_s: float) -> None:
        if self._in_progress == 0:
            self.strobe(True, start_s)
        self._in_progress += 1
        end_s = start_s + self.shutter.all_rows_s
        self._clock.call_at(end_s, lambda: self._finish(end_s))

    def _finish(self, end_s: float) -> None:
        self._in_progress -= 1
        if self._in_progress == 0:
            self.strobe(False, end_s)


class FreeRunning(Exposures):
    """An exposure in each frame period, from the construction on."""

    def __init__(self, clock: Clock, shutter: Shutter, strobe: _Strobe = lambda *_: None) -> None:
        super().__init__(clock, shutter, strobe)
        self._started_s = clock.now_s()
        clock.call_at(self._started_s, lambda: self._run(0))

    def start_s(self, number: int) -> float:
        return self._started_s + number * self.shutter.period_s

    def count_started(self, by_s: float) -> int:
        periods = (by_s - self._started_s + _ROUNDING_S) / self.shutter.period_s
        return max(0, math.floor(periods) + 1)

    def _run(self, number: int) -> None:
        if self._open:
            self._expose(self.start_s(number))
            self._clock.call_at(self.start_s(number + 1), lambda: self._run(number + 1))


class Triggered(Exposures):
    """One exposure per trigger; a trigger within a frame period of the last start is ignored."""

    def __init__(self, clock: Clock, shutter: Shutter, strobe: _Strobe = lambda *_: None) -> None:
        super().__init__(clock, shutter, strobe)
        self._lock = threading.Lock()  # a controller triggers while a program reads
        self._starts_s: list[float] = []
        self._dropped = 0  # number of earlier starts that are no longer kept

    def trigger(self) -> bool:
        now_s = self._clock.now_s()
        with self._lock:
            if self._starts_s and now_s < self._starts_s[-1] + self.shutter.period_s:
                return False
            self._starts_s.append(now_s)
            if len(self._starts_s) == 2 * KEPT_STARTS:
                del self._starts_s[:KEPT_STARTS]
                self._dropped += KEPT_STARTS
        self._clock.call_at(now_s, lambda: self._expose(now_s))
        return True

    def start_s(self, number: int) -> float:
        with self._lock:
            if number < self._dropped:
                raise ValueError(f"exposure {number} is older than the kept {len(self._starts_s)}")
            return self._starts_s[number - self._dropped]

    def count_started(self, by_s: float) -> int:
        with self._lock:
            return self._dropped + bisect_right(self._starts_s, by_s + _ROUNDING_S)

    def await_start(self, number: int, deadline_s: float) -> bool:
        while self.count_started(math.inf) <= number:
            if self._clock.now_s() >= deadline_s:
                return False
            self._clock.sleep_s(_TRIGGER_POLL_S)
        return True


# Separates the random numbers of time stamps from those of pixels.
_JITTER_STREAM = 1


@dataclass(frozen=True)
class _ReportedTiming:
    """The timing that a simulated camera reports of its exposures."""

    # From the sequence number and the true start to the reported start.
    start_s: Callable[[int, float], float] = lambda _sequence, start_s: start_s
    readout_s: float | None = None
    start_uncertainty_s: float = 0.0  # how much later than reported an exposure may start


def reported_timing(
    camera: SimulatedCameraConfig | ReplayCameraConfig, simulation: SimulationConfig
) -> _ReportedTiming:
    """The timing that the rig derives from the stamps of a simulated driver."""
    camera.require_measured_mode()
    period_s, exposure_s = 1.0 / camera.frame_rate_hz, camera.exposure_ms / 1e3
    lag_ms = simulation.stamp_lag_ms

    def reported_start_s(sequence: int, start_s: float) -> float:
        stamp_s = start_s
        if lag_ms is not None:
            stamp_s += lag_ms / 1e3
            if simulation.stamp_jitter_ms > 0.0:
                rng = np.random.default_rng((simulation.placement.seed, sequence, _JITTER_STREAM))
                stamp_s += rng.uniform(0.0, simulation.stamp_jitter_ms / 1e3)
        return camera.exposure_start_s(
            stamp_s, claims_start=lag_ms is None, period_s=period_s, exposure_s=exposure_s
        )

    return _ReportedTiming(
        start_s=reported_start_s,
        readout_s=simulation.readout_ms / 1e3 if lag_ms is None else camera.readout_s,
        # A stamp at the true start is reported this much earlier.
        start_uncertainty_s=max(0.0, -reported_start_s(0, 0.0))
        if lag_ms is None
        else camera.start_uncertainty_s,
    )


# Number of buffers of the driver, the same as of `V4l2Camera`.
_BUFFERS = 4
# Pause after an exposure, before the pixels are computed: the simulated controller may switch its
# LEDs then, and needs the processor.
_SWITCH_PAUSE_S = 0.001
_MIN_EXPOSURE_MS = 0.02  # of common industrial cameras


class LitScene(Protocol):
    """Light from a scene: (N, H, W) of each LED alone, and (H, W) with all LEDs off."""

    @property
    def lights(self) -> FloatMap: ...

    @property
    def ambient(self) -> FloatMap: ...


class SimulatedCamera:
    """Camera with a global or a rolling shutter, and a queue of a few buffers as with V4L2."""

    def __init__(
        self,
        board: SimulatedBoard,
        clock: Clock,
        scene: LitScene,
        sensor: Sensor,
        exposures: Exposures,
        *,
        seed: int,
        reported: _ReportedTiming | None = None,
    ) -> None:
        self.scene = scene
        self.sensor = sensor
        self.exposures = exposures
        self._board = board
        self._clock = clock
        self._seed = seed
        self._reported = reported or _ReportedTiming()
        # Number and scene of each frame in the queue; its pixels are computed when it is read.
        self._queue: deque[tuple[int, LitScene]] = deque()
        self._next_sequence = 0
        self._open = True

    @property
    def info(self) -> CameraInfo:
        rows, columns = self.scene.ambient.shape
        kind, name, controls = "simulated", "simulated camera", {}
        if isinstance(self.sensor, RecordedPixels):
            origin = self.sensor.origin
            kind, name, controls = "replay", f"replay of {origin['set_file']}", {"replay": origin}
        return CameraInfo(
            kind=kind,
            name=name,
            width_px=columns,
            height_px=rows,
            bit_depth=self.sensor.bit_depth,
            frame_period_s=self.exposures.shutter.period_s,
            exposure_s=self.exposures.shutter.exposure_s,
            queue_length=_BUFFERS,
            readout_s=self._reported.readout_s,
            start_uncertainty_s=self._reported.start_uncertainty_s,
            gain_e_per_dn=self.sensor.gain_e_per_dn,
            read_noise_dn=self.sensor.read_noise_dn,
            black_level_dn=self.sensor.black_level_dn,
            controls=controls,
            **self.sensor.info_fields,
        )

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        """Shortest and longest exposure; the same for the pixels of a recorded set."""
        shutter = self.exposures.shutter
        if isinstance(self.sensor, RecordedPixels):
            return 1e3 * shutter.exposure_s, 1e3 * shutter.exposure_s
        return _MIN_EXPOSURE_MS, 1e3 * shutter.period_s

    def set_exposure(self, exposure_ms: float) -> None:
        """Change the exposure of all frames that have not been read."""
        require_exposure(exposure_ms, self.exposure_range_ms)
        self.exposures.shutter = replace(self.exposures.shutter, exposure_s=exposure_ms / 1e3)

    def replace_scene(self, scene: LitScene, seed: int) -> None:
        """Exchange the part below the camera; frames in the queue still show the old one."""
        self._fill_buffers(self._clock.now_s())
        self.scene = scene
        self._seed = seed

    def read(self, timeout_s: float) -> Frame:
        if not self._open:
            raise CameraError("the camera is closed")
        now_s = self._clock.now_s()
        self._fill_buffers(now_s)
        if self._queue:
            return self._develop(*self._queue.popleft())
        is_known = self.exposures.await_start(self._next_sequence, now_s + timeout_s)
        ready_s = self.ready_s(self._next_sequence) if is_known else math.inf
        if ready_s - now_s > timeout_s:
            self._clock.sleep_s(now_s + timeout_s - self._clock.now_s())
            raise CameraError(f"no frame from the camera in {timeout_s:g} s")
        # The pixels are computed during the transfer; on the real clock the frame would be late.
        self._clock.sleep_s(ready_s - TRANSFER_S + _SWITCH_PAUSE_S - self._clock.now_s())
        self._fill_buffers(ready_s)
        frame = self._develop(*self._queue.popleft())
        self._clock.sleep_s(ready_s - self._clock.now_s())
        return frame

    @property
    def has_next(self) -> bool:
        """Whether a frame waits or is being exposed."""
        started = self.exposures.count_started(self._clock.now_s())
        return bool(self._queue) or started > self._next_sequence

    def ready_s(self, sequence: int) -> float:
        """Time at which a driver has the whole frame, which most drivers report as its stamp."""
        return self.exposures.start_s(sequence) + self.exposures.shutter.ready_after_s

    def close(self) -> None:
        self._open = False
        self.exposures.close()
        self._queue.clear()

    def _fill_buffers(self, now_s: float) -> None:
        """Fill free buffers with the frames that are finished at `now_s`."""
        finished = self.exposures.count_started(now_s - self.exposures.shutter.ready_after_s)
        while self._next_sequence < finished and len(self._queue) < _BUFFERS:
            self._queue.append((self._next_sequence, self.scene))
            self._next_sequence += 1
        # Frames without a free buffer are lost.
        self._next_sequence = max(self._next_sequence, finished)

    def _develop(self, sequence: int, scene: LitScene) -> Frame:
        exposure_s = self.exposures.shutter.exposure_s
        true_start_s = self.exposures.start_s(sequence)
        total_light_ms = scene.ambient * np.float32(1e3 * exposure_s)
        for led, image in enumerate(scene.lights):
            led_output_ms = self._led_output_ms(led, true_start_s, len(image))
            if led_output_ms is not None:
                total_light_ms += image * led_output_ms
        rng = np.random.default_rng((self._seed, sequence))
        start_s = self._reported.start_s(sequence, true_start_s)
        return Frame(
            pixels=self.sensor.expose(total_light_ms, rng),
            bit_depth=self.sensor.bit_depth,
            exposure_start_s=start_s,
            exposure_end_s=start_s + exposure_s,
            sequence=sequence,
        )

    def _led_output_ms(self, led: int, start_s: float, rows: int) -> np.float32 | FloatMap | None:
        """Integrate an LED's output over the exposure: (rows, 1), or one value; None if zero."""
        shutter = self.exposures.shutter
        all_rows_s = self._board.output_integral_s(led, start_s, start_s + shutter.all_rows_s)
        if all_rows_s <= 0.0:
            return None
        if shutter.readout_s == 0.0:
            return np.float32(1e3 * all_rows_s)
        starts = np.linspace(start_s, start_s + shutter.readout_s, rows)
        per_row = (
            self._board.output_integral_s(led, row_s, row_s + shutter.exposure_s)
            for row_s in starts.tolist()
        )
        return np.fromiter(per_row, np.float32, rows)[:, None] * np.float32(1e3)
