"""A camera above a simulated scene, with the timing and the stale buffers of a real driver."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from firmware_sim import Clock, SimulatedBoard
from rig.camera import CameraInfo, Frame
from rig.errors import CameraError

from .sensor import Sensor

__all__ = ["CameraIdentity", "LitScene", "SimulatedCamera"]

# From the end of the last row's exposure to the frame in the driver's queue.
_TRANSFER_S = 0.004
# A controller that steps at the end of an exposure needs the processor first.
_STEP_S = 0.001
# How often a program that waits for a frame looks whether one has been triggered.
_TRIGGER_LOOK_S = 0.001
# A clock that slept until a frame was ready may stand a hair before it.
_ROUNDING_S = 1e-6


class LitScene(Protocol):
    """What there is to see: (N, H, W) of each light, (H, W) without any."""

    @property
    def lights(self) -> npt.NDArray[np.float32]: ...

    @property
    def ambient(self) -> npt.NDArray[np.float32]: ...


@dataclass(frozen=True)
class CameraIdentity:
    """What a simulated camera says it is."""

    kind: str = "simulated"
    name: str = "simulated camera"
    controls: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Exposed:
    """A filled buffer. Its pixels are made when somebody asks for them."""

    sequence: int
    start_s: float
    scene: LitScene


def _unwired(_exposing: bool, _at_s: float) -> None:
    pass


def _as_it_is(_sequence: int, start_s: float) -> float:
    return start_s


class SimulatedCamera:
    """Camera with a global or a rolling shutter, free-running or triggered.

    Every frame period an exposure begins; or at each trigger, which is lost if it comes within a
    frame period of the one before. If one of the driver's buffers is free the frame goes there,
    otherwise it is lost and only its sequence number is missed: a program that comes late finds
    the OLDEST frames first, as with V4L2. The light of a frame is the integral over its exposure
    of what each LED really put out, so it may hold two LEDs, or the one before. With a rolling
    shutter each row has an exposure of its own, the last one `readout_s` after the first.

    `strobe` is the wire that tells whether any row is exposed, with the time of the change.
    `reported_start_s` makes of a frame's sequence number and the true start of its exposure what
    the rig is told of it, which is early by `start_known_to_s` at most. Of the readout it is told
    `reported_readout_s`.
    """

    def __init__(
        self,
        board: SimulatedBoard,
        clock: Clock,
        scene: LitScene,
        sensor: Sensor,
        *,
        frame_period_s: float,
        exposure_s: float,
        seed: int,
        buffers: int = 4,
        readout_s: float = 0.0,
        reported_start_s: Callable[[int, float], float] = _as_it_is,
        reported_readout_s: float | None = None,
        start_known_to_s: float = 0.0,
        identity: CameraIdentity = CameraIdentity(),
        strobe: Callable[[bool, float], object] = _unwired,
        triggered: bool = False,
    ) -> None:
        self._board = board
        self._clock = clock
        self._scene = scene
        self._sensor = sensor
        self._seed = seed
        self._period_s = frame_period_s
        self._exposure_s = exposure_s
        self._buffers = buffers
        self._readout_s = readout_s
        self._reported_start_s = reported_start_s
        self._reported_readout_s = reported_readout_s
        self._start_known_to_s = start_known_to_s
        self._identity = identity
        self._strobe = strobe
        self._exposures = 0  # that are under way: with a rolling shutter they may overlap
        self._queue: deque[_Exposed] = deque()
        # Of triggered exposures whose frames are not in the queue yet.
        self._triggered_s: deque[float] | None = deque() if triggered else None
        self._ready_for_trigger_s = self._started_s = clock.now_s()
        self._next_sequence = 0
        self._open = True
        if not triggered:
            clock.call_at(self._started_s, lambda: self._run_free(0))

    @property
    def info(self) -> CameraInfo:
        """What holds for every frame."""
        rows, columns = self._scene.ambient.shape
        return CameraInfo(
            kind=self._identity.kind,
            name=self._identity.name,
            width_px=columns,
            height_px=rows,
            bit_depth=self._sensor.bit_depth,
            frame_period_s=self._period_s,
            exposure_s=self._exposure_s,
            queue_length=self._buffers,
            readout_s=self._reported_readout_s,
            start_known_to_s=self._start_known_to_s,
            gain_e_per_dn=self._sensor.gain_e_per_dn,
            read_noise_dn=self._sensor.read_noise_dn,
            black_level_dn=self._sensor.black_level_dn,
            controls=self._identity.controls,
        )

    def look_at(self, scene: LitScene, seed: int) -> None:
        """Exchange the part below the camera. Frames already in the queue show the old one."""
        self._fill_buffers(self._clock.now_s())
        self._scene = scene
        self._seed = seed

    def read(self, timeout_s: float) -> Frame:
        """The oldest frame in the queue, or the next one to come."""
        if not self._open:
            raise CameraError("the camera is closed")
        now_s = self._clock.now_s()
        self._fill_buffers(now_s)
        if not self._queue:
            ready_s = self._next_ready_s(now_s + timeout_s)
            if ready_s - now_s > timeout_s:
                self._clock.sleep_s(now_s + timeout_s - self._clock.now_s())
                raise CameraError(f"no frame from the camera in {timeout_s:g} s")
            # Its pixels are made while it is transferred, or on the real clock it would come late.
            self._clock.sleep_s(ready_s - _TRANSFER_S + _STEP_S - self._clock.now_s())
            self._fill_buffers(ready_s)
            frame = self._developed(self._queue.popleft())
            self._clock.sleep_s(ready_s - self._clock.now_s())
            return frame
        return self._developed(self._queue.popleft())

    def frame_end_s(self, frame: Frame) -> float:
        """When a driver would have the whole frame, which is what most of them stamp."""
        return self._start_s(frame.sequence) + self._ready_after_s

    def trigger(self) -> None:
        """A pulse on the trigger line, at this moment."""
        now_s = self._clock.now_s()
        if self._triggered_s is None or now_s < self._ready_for_trigger_s:
            return
        self._ready_for_trigger_s = now_s + self._period_s
        self._triggered_s.append(now_s)
        self._clock.call_at(now_s, lambda: self._expose(now_s))

    def close(self) -> None:
        """Stop streaming; a second call does nothing."""
        self._open = False
        self._queue.clear()

    @property
    def _ready_after_s(self) -> float:
        return self._exposure_s + self._readout_s + _TRANSFER_S

    def _start_s(self, sequence: int) -> float:
        return self._started_s + sequence * self._period_s

    def _run_free(self, sequence: int) -> None:
        if self._open:
            self._expose(self._start_s(sequence))
            self._clock.call_at(self._start_s(sequence + 1), lambda: self._run_free(sequence + 1))

    def _expose(self, start_s: float) -> None:
        """Turn the strobe on for an exposure, of the first row to that of the last."""
        if self._exposures == 0:
            self._strobe(True, start_s)
        self._exposures += 1
        end_s = start_s + self._exposure_s + self._readout_s
        self._clock.call_at(end_s, lambda: self._finish(end_s))

    def _finish(self, end_s: float) -> None:
        self._exposures -= 1
        if self._exposures == 0:
            self._strobe(False, end_s)

    def _next_ready_s(self, deadline_s: float) -> float:
        """When the next frame will be in the queue; infinite if none is triggered by then."""
        if self._triggered_s is None:
            return self._start_s(self._next_sequence) + self._ready_after_s
        while not self._triggered_s:
            if self._clock.now_s() >= deadline_s:
                return math.inf
            self._clock.sleep_s(_TRIGGER_LOOK_S)
        return self._triggered_s[0] + self._ready_after_s

    def _fill_buffers(self, now_s: float) -> None:
        """Bring the queue to where the driver's would be at `now_s`."""
        if self._triggered_s is not None:
            while self._triggered_s and self._triggered_s[0] + self._ready_after_s <= (
                now_s + _ROUNDING_S
            ):
                start_s = self._triggered_s.popleft()
                if len(self._queue) < self._buffers:
                    self._queue.append(_Exposed(self._next_sequence, start_s, self._scene))
                self._next_sequence += 1
            return
        since_s = now_s - self._started_s - self._ready_after_s + _ROUNDING_S
        finished = math.floor(since_s / self._period_s)
        while self._next_sequence <= finished and len(self._queue) < self._buffers:
            start_s = self._start_s(self._next_sequence)
            self._queue.append(_Exposed(self._next_sequence, start_s, self._scene))
            self._next_sequence += 1
        # No free buffer: what was exposed meanwhile is lost.
        self._next_sequence = max(self._next_sequence, finished + 1)

    def _developed(self, exposed: _Exposed) -> Frame:
        light_ms = exposed.scene.ambient * np.float32(1e3 * self._exposure_s)
        for led, image in enumerate(exposed.scene.lights):
            lit_ms = self._lit_ms(led, exposed.start_s, len(image))
            if lit_ms is not None:
                light_ms += image * lit_ms
        rng = np.random.default_rng((self._seed, exposed.sequence))
        start_s = self._reported_start_s(exposed.sequence, exposed.start_s)
        return Frame(
            pixels=self._sensor.expose(light_ms, rng),
            bit_depth=self._sensor.bit_depth,
            exposure_start_s=start_s,
            exposure_end_s=start_s + self._exposure_s,
            sequence=exposed.sequence,
        )

    def _lit_ms(
        self, led: int, start_s: float, rows: int
    ) -> np.float32 | npt.NDArray[np.float32] | None:
        """How long an LED shone on each row (rows, 1), or on all; None if not at all."""
        window_s = self._exposure_s + self._readout_s
        whole_s = self._board.output_integral_s(led, start_s, start_s + window_s)
        if whole_s <= 0.0:
            return None
        if self._readout_s == 0.0:
            return np.float32(1e3 * whole_s)
        starts = np.linspace(start_s, start_s + self._readout_s, rows)
        per_row = (
            self._board.output_integral_s(led, row_s, row_s + self._exposure_s)
            for row_s in starts.tolist()
        )
        return np.fromiter(per_row, np.float32, rows)[:, None] * np.float32(1e3)
