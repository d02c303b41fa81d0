"""How late the camera is: an LED is switched and the change awaited in the picture."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .camera import Frame, FrameFlag
from .camera_config import CameraConfig
from .config import RigConfig
from .errors import CameraError, ConfigError
from .latency_fit import StepFit, Steps, fit_steps
from .rig import Rig

__all__ = ["CameraLatency", "Whole", "measure_latency", "without_timing"]

Floats = npt.NDArray[np.float64]

_BANDS = 32
# Periods of frames looked at after a step, beyond those that may be older than it.
_PERIODS_AFTER = 2.0
_READ_TIMEOUT_S = 2.0
# A band whose light changes by less than this share of the range says nothing.
_LEAST_CONTRAST = 0.01
# A picture in which other light flickers does not follow the model.
_MOST_MISFIT = 0.06
_LEAST_CAUGHT = 6
# Of a change, when the picture is called whole.
_WHOLE = 0.98
_MOST_SATURATED = 0.01
_MOST_FRAMES = 64
# Quartz against quartz.
_CLOCK_DRIFT = 5e-5
_NEIGHBOURS = 8
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


@dataclass
class _Watched:
    """Frames as they came, and the light in bands of their rows."""

    reported_s: list[float] = field(default_factory=list)
    came_s: list[float] = field(default_factory=list)
    step: list[int] = field(default_factory=list)
    levels: list[Floats] = field(default_factory=list)


@dataclass(frozen=True)
class _Step:
    asked_s: float
    acknowledged_s: float
    controller_s: float
    rising: bool


def without_timing(config: RigConfig) -> RigConfig:
    """The configuration with nothing known of the camera's time stamps.

    Raises
    ------
    ConfigError
        If the camera has none.
    """
    if config.camera.kind == "opencv":
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
    """Switch an LED on and off `steps` times, at all phases of the frames, and see when it shows.

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
    switches, watched = _watch(rig, led, each(range(2 * steps)), 2 * steps, random.Random(seed))
    info = rig.camera.info
    switched_s, unknown_s = _switch_times(switches)
    of_step = np.array(watched.step)
    rising = np.array([step.rising for step in switches])
    shares, kept = _shares(np.array(watched.levels), of_step, rising, 1 << info.bit_depth)
    fit = fit_steps(
        Steps(
            reported_s=np.array(watched.reported_s) - switched_s[of_step],
            rising=rising[of_step],
            shares=shares,
            bands=_band_places(info.height_px)[kept],
            exposure_s=info.exposure_s,
            period_s=info.frame_period_s,
        )
    )
    if fit.misfit > _MOST_MISFIT:
        raise CameraError(
            f"the picture does not follow LED {led} as light that is switched does (misfit "
            f"{fit.misfit:.1%}); does other light change, or the camera expose by itself?"
        )
    if fit.caught < _LEAST_CAUGHT:
        raise CameraError(
            f"only {fit.caught} frames caught LED {led} being switched, at least {_LEAST_CAUGHT} "
            "are needed; ask for more steps, or lengthen the exposure"
        )
    acknowledged_s = np.array([step.acknowledged_s for step in switches])
    after_s = np.array(watched.came_s) - acknowledged_s[of_step]
    done = np.where(rising[of_step][:, None], shares, 1.0 - shares) >= _WHOLE
    return CameraLatency(
        camera=_camera_keys(rig.config.camera, fit, unknown_s, info.frame_period_s),
        settle_ms=_rounded_up(1e3 * _SETTLED_PER_RISE * max(fit.rise_s, fit.fall_s)),
        first_row=_whole(done[:, -1 if fit.bottom_up else 0], after_s, of_step),
        last_row=_whole(done[:, 0 if fit.bottom_up else -1], after_s, of_step),
        fit=fit,
        switches=len(switches),
    )


def _watch(
    rig: Rig, led: int, numbers: Iterable[int], count: int, rng: random.Random
) -> tuple[list[_Step], _Watched]:
    """Every frame from each switch until the change must be long over."""
    info, clock, watched = rig.camera.info, rig.clock, _Watched()
    after_s = rig.config.lights.settle_ms / 1e3 + _PERIODS_AFTER * info.frame_period_s
    # One in each part of the period, in no order, so that no phase is missed.
    phases = rng.sample(range(count), count)
    switches: list[_Step] = []
    dark_s = rig.lights.off().acknowledged_s
    for _ in _frames_until(rig, dark_s + after_s):
        pass
    for number in numbers:
        clock.sleep_s((phases[number] + rng.random()) / count * info.frame_period_s)
        asked_s, rising = clock.now_s(), number % 2 == 0
        switch = rig.lights.select(led) if rising else rig.lights.off()
        switches.append(
            _Step(asked_s, switch.acknowledged_s, switch.controller_time_us / 1e6, rising)
        )
        for frame in _frames_until(rig, switch.acknowledged_s + after_s):
            watched.reported_s.append(frame.exposure_start_s)
            watched.came_s.append(clock.now_s())
            watched.step.append(number)
            watched.levels.append(_band_levels(frame))
        rig.lights.confirm(led if rising else None)
    rig.lights.off()
    return switches, watched


def _frames_until(rig: Rig, begun_s: float) -> Iterator[Frame]:
    """All good frames up to the first that is said to have begun then or later."""
    for _ in range(_MOST_FRAMES):
        frame = rig.camera.read(_READ_TIMEOUT_S)
        if frame.flags == FrameFlag.GOOD:
            yield frame
            if frame.exposure_start_s >= begun_s:
                return
    raise CameraError(
        f"{_MOST_FRAMES} frames came and none of them after the switch, by its time stamp; the "
        "camera's time stamps are not on the rig's clock"
    )


def _band_places(rows: int) -> Floats:
    """Where the bands' middles are between the first row, 0, and the last, 1."""
    edges = np.linspace(0, rows, min(_BANDS, rows) + 1).round()
    places: Floats = ((edges[:-1] + edges[1:] - 1.0) / 2.0) / (rows - 1)
    return places


def _band_levels(frame: Frame) -> Floats:
    """Mean pixel value in each band of rows."""
    full = (1 << frame.bit_depth) - 1
    saturated = np.count_nonzero(frame.pixels >= full) / frame.pixels.size
    if saturated > _MOST_SATURATED:
        raise CameraError(
            f"{saturated:.0%} of the pixels are saturated, and do not show how much light there "
            "was; shorten the exposure, or take the LED's level down"
        )
    rows = frame.pixels.mean(axis=1, dtype=np.float64)
    edges = np.linspace(0, len(rows), min(_BANDS, len(rows)) + 1).round().astype(np.intp)
    levels: Floats = np.add.reduceat(rows, edges[:-1]) / np.diff(edges)
    return levels


def _switch_times(switches: list[_Step]) -> tuple[Floats, float]:
    """When each step was, on the rig's clock, and how uncertain that is.

    It was between question and answer, and when exactly the controller says on its own clock. How
    that clock stands to ours lies between bounds that each exchange gives, and its neighbours'
    bounds are narrower than its own.
    """
    asked, answered, theirs = (
        np.array([getattr(step, name) for step in switches])
        for name in ("asked_s", "acknowledged_s", "controller_s")
    )
    switched, unknown_s = np.empty(len(switches)), 0.0
    for index in range(len(switches)):
        near = slice(max(index - _NEIGHBOURS, 0), index + _NEIGHBOURS + 1)
        low, high = float((asked - theirs)[near].max()), float((answered - theirs)[near].min())
        drift_s = _CLOCK_DRIFT * float(answered[near].max() - asked[near].min())
        if low > high + drift_s:
            # Its clock was set, or it restarted: what is left are this exchange's own bounds.
            low, high = asked[index] - theirs[index], answered[index] - theirs[index]
        switched[index] = theirs[index] + (low + high) / 2.0
        unknown_s = max(unknown_s, abs(high - low) / 2.0 + drift_s)
    return switched, unknown_s


def _shares(
    levels: Floats, of_step: npt.NDArray[np.intp], rising: npt.NDArray[np.bool_], values: int
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """(F, B) how much of the LED's light is in each band, and (all bands,) which show it at all."""
    last = np.append(np.diff(of_step) > 0, True)
    lit = np.median(levels[last & rising[of_step]], axis=0)
    dark = np.median(levels[last & ~rising[of_step]], axis=0)
    kept = lit - dark > _LEAST_CONTRAST * values
    if np.count_nonzero(kept) < 2:
        raise CameraError(
            "the LED makes no difference in the picture; is it the right one, and does the camera "
            "see something bright?"
        )
    return (levels[:, kept] - dark[kept]) / (lit - dark)[kept], kept


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


def _whole(done: npt.NDArray[np.bool_], after_s: Floats, of_step: npt.NDArray[np.intp]) -> Whole:
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
