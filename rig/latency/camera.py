"""How late the camera is: an LED is switched and the change awaited in the picture."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.config.camera import CameraConfig, OpencvCameraConfig
from rig.config.rig import RigConfig
from rig.errors import CameraError, ConfigError
from rig.rig import Rig

from .fit import StepFit
from .recording import evaluate, record_steps

__all__ = ["CameraLatency", "Whole", "measure_latency", "without_timing"]

# A picture in which other light flickers does not follow the model.
_MOST_MISFIT = 0.08
_LEAST_CAUGHT = 6
# Of a change, when the picture is called whole.
_WHOLE = 0.98
# ln 1000 time constants: what is missing then is a thousandth.
_SETTLED_PER_RISE = math.log(1000.0) / math.log(9.0)


@dataclass(frozen=True)
class Whole:
    """How long it takes from the acknowledge until a row has the change and no part of the old.

    `typical_ms` is the median until a program holds such a frame, `most_ms` the worst, and
    `most_frames` how many frames a program was given before it, those in the queue included.
    """

    typical_ms: float
    most_ms: float
    most_frames: int


@dataclass(frozen=True)
class CameraLatency:
    """What ``ps4rig rig latency`` finds, in the terms of ``rig.toml``.

    Attributes
    ----------
    camera
        The keys of ``[camera]`` that hold it.
    settle_ms
        What the light takes to be within a thousandth of its level.
    first_row, last_row
        When the change is in the picture, in the order of their exposure.
    fit
        What was fitted to the frames.
    switches
        How many times the LED was switched, on or off.
    """

    camera: dict[str, str | float]
    settle_ms: float
    first_row: Whole
    last_row: Whole
    fit: StepFit
    switches: int


def without_timing(config: RigConfig) -> RigConfig:
    """The configuration with nothing known of the camera's time stamps.

    Raises
    ------
    ConfigError
        If the camera has none.
    """
    if isinstance(config.camera, OpencvCameraConfig):
        raise ConfigError("camera.kind = 'opencv' has no time stamps to measure; use 'v4l2'")
    return config.with_changes(
        camera={
            "timestamp_marks": "frame_end",
            "timestamp_offset_ms": 0.0,
            "timestamp_uncertainty_ms": 0.0,
            "readout_ms": None,
            "timing_measured_at": None,
        },
        # It is we who switch, and the camera does not wait for it.
        lights={"synchronisation": "software"},
    )


def measure_latency(
    rig: Rig,
    led: int = 0,
    steps: int = 40,
    each: Callable[[range], Iterable[int]] = iter,
    seed: int = 1,
) -> CameraLatency:
    """Switch an LED on and off `steps` times against the frames, and see when it shows.

    Parameters
    ----------
    rig
        Opened with `without_timing` of its configuration.
    led
        Which LED.
    steps
        Each is one on and one off.
    each
        Goes through the numbers of all switches; a progress bar, for example.
    seed
        Of the phases.

    Raises
    ------
    CameraError
        If the picture does not follow the LED, or follows something else as well.
    HardwareError
        If the controller or the camera fails.
    """
    recording = record_steps(rig, led, each(range(2 * steps)), 2 * steps, random.Random(seed))
    seen = evaluate(rig, recording)
    fit = seen.fit
    if fit.misfit > _MOST_MISFIT:
        raise CameraError(
            f"the picture does not follow LED {led} as light that is switched does (misfit "
            f"{fit.misfit:.1%}); does other light change, does the camera expose by itself, or do "
            "its time stamps jitter by as much as it exposes?"
        )
    if fit.caught < _LEAST_CAUGHT:
        raise CameraError(
            f"only {fit.caught} frames caught LED {led} being switched, at least {_LEAST_CAUGHT} "
            "are needed; ask for more steps, or lengthen the exposure"
        )
    # Of the switches at all phases: how long it takes where nobody aims.
    anywhere = seen.of_step < steps
    done = np.where(seen.steps.rising[:, None], seen.steps.shares, 1.0 - seen.steps.shares)[
        anywhere
    ]
    rows = (-1, 0) if fit.bottom_up else (0, -1)
    first_row, last_row = (
        _whole(done[:, row] >= _WHOLE, seen.after_s[anywhere], seen.of_step[anywhere])
        for row in rows
    )
    return CameraLatency(
        camera=_camera_keys(rig.config.camera, fit, seen.unknown_s, seen.steps.period_s),
        settle_ms=_rounded_up(1e3 * _SETTLED_PER_RISE * max(fit.rise_s, fit.fall_s)),
        first_row=first_row,
        last_row=last_row,
        fit=fit,
        switches=len(recording.switches),
    )


def _camera_keys(
    config: CameraConfig, fit: StepFit, unknown_s: float, period_s: float
) -> dict[str, str | float]:
    """What was found, as keys; what had to be rounded was rounded towards the earlier start."""
    readout_ms = round(1e3 * min(fit.readout_s, period_s), 2)
    # Without timing a frame is taken to begin one period and one exposure before its stamp, with
    # these keys one readout and one exposure before the stamp and its offset.
    offset_ms = 1e3 * (fit.start_s - period_s) + readout_ms
    return {
        "timestamp_marks": "frame_end",
        "timestamp_offset_ms": -_rounded_up(-offset_ms),
        "timestamp_uncertainty_ms": _rounded_up(1e3 * (fit.deviation_s + unknown_s)),
        "readout_ms": readout_ms,
        "timing_measured_at": config.mode,
    }


def _whole(
    done: npt.NDArray[np.bool_], after_s: npt.NDArray[np.float64], of_step: npt.NDArray[np.intp]
) -> Whole:
    times_s, frames = [], []
    for step in np.unique(of_step):
        chosen = np.flatnonzero(of_step == step)
        # From the last frame on that had not all of it.
        missing = np.flatnonzero(~done[chosen])
        first = int(missing[-1]) + 1 if len(missing) else 0
        if first < len(chosen):
            times_s.append(float(after_s[chosen[first]]))
            frames.append(first)
    if not times_s:
        raise CameraError("the change was never whole in the picture; does other light change?")
    return Whole(1e3 * float(np.median(times_s)), 1e3 * max(times_s), max(frames))


def _rounded_up(value_ms: float) -> float:
    return math.ceil(100.0 * value_ms - 1e-6) / 100.0
