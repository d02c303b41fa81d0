"""Measure the camera's timing: switch an LED, and find the change in the frames."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from classify.base.arrays import BoolArray, Floats, Indices
from classify.base.errors import ConfigError
from rig.cameras.config import CameraConfig, StampedCameraConfig
from rig.config.rig import RigConfig
from rig.errors import CameraError
from rig.rig import Rig

from .fit import StepFit
from .recording import evaluate, record_steps

# Largest rms residual of the shares of light: more than with stamps that jitter by 3 ms, less than
# with flickering light (both in tests/rig/latency/test_camera.py).
_MAX_MISFIT = 0.08
# Fewest frames that contain a switch: with fewer, their scatter is not known.
_MIN_CAUGHT = 6
# Share of a change from which a row counts as completely changed, within its noise.
_COMPLETE = 0.98
# Settle time within a thousandth of the level, ln 1000 time constants, by the 10 to 90 % time, ln 9
# time constants.
_SETTLED_PER_RISE = math.log(1000.0) / math.log(9.0)


@dataclass(frozen=True)
class CompleteChange:
    """Time from the acknowledge to the first frame in which a row has changed completely."""

    typical_ms: float  # median until the program has the frame
    most_ms: float
    most_frames: int  # received before it, stale ones included


@dataclass(frozen=True)
class CameraLatency:
    """The result of ``ps4rig rig latency``."""

    camera: dict[str, str | float]  # keys and values for [camera]
    settle_ms: float  # until the light is within a thousandth of its level
    first_row: CompleteChange
    last_row: CompleteChange
    fit: StepFit
    switches: int


def without_timing(config: RigConfig) -> RigConfig:
    """The configuration without any timing of the camera, to measure it anew."""
    if not isinstance(config.camera, StampedCameraConfig):
        raise ConfigError(
            f"camera.kind = {config.camera.kind!r} has no time stamps to measure; use 'v4l2'"
        )
    return config.with_changes(
        camera={
            "timestamp_marks": "frame_end",
            "timestamp_offset_ms": 0.0,
            "timestamp_uncertainty_ms": 0.0,
            "readout_ms": None,
            "timing_measured_at": None,
        },
        # This program switches the lights, and the camera runs free.
        lights={"synchronisation": "software"},
    )


def measure_latency(
    rig: Rig,
    led: int = 0,
    steps: int = 40,
    each: Callable[[range], Iterable[int]] = iter,
) -> CameraLatency:
    """Switch an LED on and off `steps` times, and measure when the frames show it."""
    recording = record_steps(rig, led, each(range(2 * steps)), 2 * steps)
    found = evaluate(rig, recording)
    fit = found.fit
    if fit.misfit > _MAX_MISFIT:
        raise CameraError(
            f"the frames do not follow LED {led}: their light differs from the model by "
            f"{fit.misfit:.1%}, limit {_MAX_MISFIT:.0%}; shield the rig from other light, and turn "
            "off automatic exposure; if it stays so, the time stamps jitter: use another camera"
        )
    if fit.caught < _MIN_CAUGHT:
        raise CameraError(
            f"only {fit.caught} exposures contain a switch of LED {led}, at least {_MIN_CAUGHT} "
            "are needed; use more --steps, or lengthen the exposure"
        )
    # Only the first half of the switches are at all phases of the frames.
    anywhere = found.of_step < steps
    shares, rising = found.steps.shares[anywhere], found.steps.rising[anywhere, None]
    is_complete = np.where(rising, shares, 1.0 - shares) >= _COMPLETE
    after_s, of_step = found.after_s[anywhere], found.of_step[anywhere]
    rows = (-1, 0) if fit.bottom_up else (0, -1)
    first_row, last_row = (_complete_change(is_complete[:, row], after_s, of_step) for row in rows)
    return CameraLatency(
        camera=_camera_keys(rig.config.camera, fit, found.unknown_s, found.steps.period_s),
        settle_ms=_rounded_up(1e3 * _SETTLED_PER_RISE * max(fit.rise_s, fit.fall_s)),
        first_row=first_row,
        last_row=last_row,
        fit=fit,
        switches=len(recording.switches),
    )


def _camera_keys(
    config: CameraConfig, fit: StepFit, unknown_s: float, period_s: float
) -> dict[str, str | float]:
    """The keys of ``[camera]``, rounded towards the earlier start."""
    readout_ms = round(1e3 * min(fit.readout_s, period_s), 2)
    # Without timing the start is taken as one period and one exposure before the stamp; with these
    # keys it is one readout and one exposure before the stamp plus its offset.
    offset_ms = 1e3 * (fit.start_s - period_s) + readout_ms
    return {
        "timestamp_marks": "frame_end",
        "timestamp_offset_ms": -_rounded_up(-offset_ms),
        "timestamp_uncertainty_ms": _rounded_up(1e3 * (fit.deviation_s + unknown_s)),
        "readout_ms": readout_ms,
        "timing_measured_at": config.mode,
    }


def _complete_change(done: BoolArray, after_s: Floats, of_step: Indices) -> CompleteChange:
    times_s, frames = [], []
    for step in np.unique(of_step):
        chosen = np.flatnonzero(of_step == step)
        # The first frame after the last incomplete one.
        missing = np.flatnonzero(~done[chosen])
        first = int(missing[-1]) + 1 if len(missing) else 0
        if first < len(chosen):
            times_s.append(float(after_s[chosen[first]]))
            frames.append(first)
    if not times_s:
        raise CameraError(
            "no frame shows a complete change of the light; shield the rig from other light"
        )
    return CompleteChange(1e3 * float(np.median(times_s)), 1e3 * max(times_s), max(frames))


def _rounded_up(value_ms: float) -> float:
    return math.ceil(100.0 * value_ms - 1e-6) / 100.0
