"""Measure the camera's timing: switch an LED, and find the change in the frames."""

import math
import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from classify.base.arrays import BoolArray, Floats, Indices
from classify.base.errors import ConfigError
from rig.acceptance import MAX_SATURATED_SHARE
from rig.cameras.camera import Frame
from rig.cameras.config import CameraConfig, StampedCameraConfig
from rig.config.rig import RigConfig
from rig.errors import CameraError, LightControllerError
from rig.fresh_frame import frames_until_fresh, next_fresh_frame, switch_to
from rig.lights.driver import Answer
from rig.lights.sequence import ClockRelation, DatedAnswer
from rig.rig import Rig
from rig.step_fit import StepFit, Steps, fit_steps

# Bands of rows in a frame: more make the fit slower, fewer the readout less certain.
_BANDS = 32
# Frame periods recorded after a step has settled, so that each row shows the new level.
_PERIODS_AFTER = 2.0
# Share of the range by which the light of a band must change. With less, noise dominates.
_MIN_CONTRAST = 0.01
# Drift of the controller's crystal relative to that of this computer. Common crystals have 50 ppm.
_CLOCK_DRIFT = 5e-5
# Number of earlier and of later exchanges whose bounds are combined with those of an exchange:
# enough that one of them is fast, few enough that the clocks hardly drift.
_NEIGHBOURS = 8
# Share of an exposure by which switches of the second half may come before or after it: the first
# half gives the ends of the exposures only roughly.
_AIM_MARGIN = 0.1


@dataclass
class _Recording:
    """Switches, and for each frame its times and the light in each band of its rows."""

    # The LED is switched on and off in turn, on first.
    switches: list[DatedAnswer] = field(default_factory=list)
    reported_s: list[float] = field(default_factory=list)
    arrived_s: list[float] = field(default_factory=list)
    step_numbers: list[int] = field(default_factory=list)
    levels: list[Floats] = field(default_factory=list)  # (B,) each


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """Result of evaluating a `_Recording`."""

    steps: Steps
    fit: StepFit
    step_numbers: Indices  # (F,) number of each frame's switch
    delays_s: Floats  # (F,) from the acknowledgement of the switch to the arrival of each frame
    command_delay_s: float  # from the command to the switch
    switch_uncertainty_s: float

    def wait_s(self, phase: float, now_s: float, reported_s: float) -> float:
        """Time until a command switches at `phase`, 0 to 1, of a coming exposure."""
        # Phases reach from a margin before the first row's exposure to one after the last row's.
        aim_s = ((1.0 + 2.0 * _AIM_MARGIN) * phase - _AIM_MARGIN) * (
            self.steps.exposure_s + self.fit.readout_s
        )
        due_s = reported_s + self.fit.start_s - self.command_delay_s + aim_s
        return (due_s - now_s) % self.steps.period_s


def _record_steps(rig: Rig, led: int, numbers: Iterable[int], count: int) -> _Recording:
    """Record every frame from each switch, first at all phases, then aimed at the exposures."""
    info, clock, recording = rig.camera.info, rig.clock, _Recording()
    rng = random.Random(1)
    record_s = rig.config.lights.settle_ms / 1e3 + _PERIODS_AFTER * info.frame_period_s
    # Stratified sampling: in each half, one switch in each stratum of the period, in random order.
    strata = [stratum for _ in range(2) for stratum in rng.sample(range(count // 2), count // 2)]
    next_fresh_frame(rig, rig.lights.off().acknowledged_s + record_s)
    first_half: _Evaluation | None = None
    for number in numbers:
        if number == count // 2:
            first_half = _evaluate(rig, recording)
        phase = (strata[number] + rng.random()) / (count // 2)
        if first_half is None:
            clock.sleep_s(phase * info.frame_period_s)
        else:
            clock.sleep_s(first_half.wait_s(phase, clock.now_s(), recording.reported_s[-1]))
        sent_s, rising = clock.now_s(), number % 2 == 0
        switch = switch_to(rig, led if rising else None)
        answer = Answer((switch.controller_time_us,), sent_s, switch.acknowledged_s)
        recording.switches.append((switch.controller_time_us, answer))
        for frame, _ in frames_until_fresh(rig, switch.acknowledged_s + record_s):
            if frame.is_corrupt:
                continue
            recording.reported_s.append(frame.exposure_start_s)
            recording.arrived_s.append(clock.now_s())
            recording.step_numbers.append(number)
            recording.levels.append(_band_levels(frame))
        rig.lights.confirm(led if rising else None)
    rig.lights.off()
    return recording


def _evaluate(rig: Rig, recording: _Recording) -> _Evaluation:
    """Evaluate the frames recorded so far."""
    info, numbers = rig.camera.info, np.array(recording.step_numbers)
    switches = recording.switches
    sent_s = np.array([answer.sent_s for _, answer in switches])
    acknowledged_s = np.array([answer.received_s for _, answer in switches])
    rising = np.arange(len(switches)) % 2 == 0
    clocks = list(_clock_relations(switches))
    switched_s = np.array(
        [clock.on_rig_s(at_us) for clock, (at_us, _) in zip(clocks, switches, strict=True)]
    )
    shares, lit_bands = _shares(np.array(recording.levels), numbers, rising, 1 << info.bit_depth)
    edges = _band_edges(info.height_px)
    steps = Steps(
        reported_s=np.array(recording.reported_s) - switched_s[numbers],
        rising=rising[numbers],
        shares=shares,
        bands=((edges[:-1] + edges[1:] - 1.0) / 2.0 / (info.height_px - 1))[lit_bands],
        exposure_s=info.exposure_s,
        period_s=info.frame_period_s,
    )
    return _Evaluation(
        steps,
        fit_steps(steps),
        numbers,
        delays_s=np.array(recording.arrived_s) - acknowledged_s[numbers],
        command_delay_s=float(np.median(switched_s - sent_s)),
        switch_uncertainty_s=max(clock.uncertainty_s for clock in clocks),
    )


def _band_edges(rows: int) -> Indices:
    """First row of each band, and the number of rows."""
    return np.linspace(0, rows, min(_BANDS, rows) + 1).round().astype(np.intp)


def _band_levels(frame: Frame) -> Floats:
    """Mean pixel value in each band of rows."""
    full = (1 << frame.bit_depth) - 1
    saturated = np.count_nonzero(frame.pixels >= full) / frame.pixels.size
    if saturated > MAX_SATURATED_SHARE:
        raise CameraError(
            f"{saturated:.0%} of the pixels are saturated and do not measure the light; shorten "
            "the exposure, or reduce the LED's level"
        )
    rows = frame.pixels.mean(axis=1, dtype=np.float64)
    edges = _band_edges(len(rows))
    levels: Floats = np.add.reduceat(rows, edges[:-1]) / np.diff(edges)
    return levels


def _clock_relations(switches: Sequence[DatedAnswer]) -> Iterator[ClockRelation]:
    """Relate the controller's clock to the rig's at each switch."""
    for index, switch in enumerate(switches):
        neighbours = switches[max(index - _NEIGHBOURS, 0) : index + _NEIGHBOURS + 1]
        try:
            yield ClockRelation.of(neighbours, _CLOCK_DRIFT)
        except LightControllerError:
            # The clock was set or restarted: only the bounds of this exchange hold.
            yield ClockRelation.of([switch], _CLOCK_DRIFT)


def _shares(
    levels: Floats, step_numbers: Indices, rising: BoolArray, value_range: int
) -> tuple[Floats, BoolArray]:
    """(F, B) share of the LED's light in each band, and which of all bands show it."""
    is_last_of_step = np.append(np.diff(step_numbers) > 0, True)
    brightest = np.median(levels[is_last_of_step & rising[step_numbers]], axis=0)
    dark = np.median(levels[is_last_of_step & ~rising[step_numbers]], axis=0)
    lit_bands = brightest - dark > _MIN_CONTRAST * value_range
    if np.count_nonzero(lit_bands) < 2:
        raise CameraError(
            "the LED makes no difference in the frames; choose an LED that works, and put a bright "
            "surface below the camera"
        )
    return (levels[:, lit_bands] - dark[lit_bands]) / (brightest - dark)[lit_bands], lit_bands


# Largest rms residual of the shares of light: more than with stamps that jitter by 3 ms, less than
# with flickering light (both in tests/rig/test_latency.py).
_MAX_MISFIT = 0.08
# Number of frames whose exposure must contain a switch. With fewer, their scatter is unknown.
_MIN_CAUGHT = 6
# Share of a change from which a row counts as completely changed, within its noise.
_COMPLETE = 0.98
# Settle time to a thousandth of the level, in rise times from 10 to 90 %. An exponential takes
# ln 1000 and ln 9 time constants for them.
_SETTLED_PER_RISE = math.log(1000.0) / math.log(9.0)


@dataclass(frozen=True)
class _CompleteChange:
    """The first frame in which a row shows all of a change of the light."""

    typical_ms: float  # median time from the acknowledgement until the program has the frame
    most_ms: float  # the longest one
    most_frames: int  # largest number of frames received before it, stale ones included


@dataclass(frozen=True)
class CameraLatency:
    """The result of ``ps4rig rig latency``."""

    camera: dict[str, str | float]  # keys and values for [camera]
    settle_ms: float  # until the light is within a thousandth of its level
    first_row: _CompleteChange
    last_row: _CompleteChange
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
    progress: Callable[[range], Iterable[int]] = iter,
) -> CameraLatency:
    """Switch an LED on and off `steps` times, and measure when the frames show it."""
    recording = _record_steps(rig, led, progress(range(2 * steps)), 2 * steps)
    evaluation = _evaluate(rig, recording)
    fit = evaluation.fit
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
    # Only the first half of the switches is spread over all phases of the frames.
    unaimed = evaluation.step_numbers < steps
    shares, rising = evaluation.steps.shares[unaimed], evaluation.steps.rising[unaimed, None]
    is_complete = np.where(rising, shares, 1.0 - shares) >= _COMPLETE
    delays_s, numbers = evaluation.delays_s[unaimed], evaluation.step_numbers[unaimed]
    rows = (-1, 0) if fit.bottom_up else (0, -1)
    first_row, last_row = (_complete_change(is_complete[:, row], delays_s, numbers) for row in rows)
    return CameraLatency(
        camera=_camera_keys(
            rig.config.camera, fit, evaluation.switch_uncertainty_s, evaluation.steps.period_s
        ),
        settle_ms=_rounded_up(1e3 * _SETTLED_PER_RISE * max(fit.rise_s, fit.fall_s)),
        first_row=first_row,
        last_row=last_row,
        fit=fit,
        switches=len(recording.switches),
    )


def _camera_keys(
    config: CameraConfig, fit: StepFit, switch_uncertainty_s: float, period_s: float
) -> dict[str, str | float]:
    """The keys of ``[camera]``, rounded towards the earlier start."""
    readout_ms = round(1e3 * min(fit.readout_s, period_s), 2)
    # Without timing the start is taken as one period and one exposure before the stamp; with these
    # keys it is one readout and one exposure before the stamp plus its offset.
    offset_ms = 1e3 * (fit.start_s - period_s) + readout_ms
    return {
        "timestamp_marks": "frame_end",
        "timestamp_offset_ms": -_rounded_up(-offset_ms),
        "timestamp_uncertainty_ms": _rounded_up(1e3 * (fit.deviation_s + switch_uncertainty_s)),
        "readout_ms": readout_ms,
        "timing_measured_at": config.mode,
    }


def _complete_change(
    is_complete: BoolArray, delays_s: Floats, step_numbers: Indices
) -> _CompleteChange:
    """Find the first complete frame of each step, from (F,) completeness of one row."""
    complete_s, frames_before = [], []
    for number in np.unique(step_numbers):
        frames = np.flatnonzero(step_numbers == number)
        # The first frame after the last incomplete one.
        incomplete = np.flatnonzero(~is_complete[frames])
        first = int(incomplete[-1]) + 1 if len(incomplete) else 0
        if first < len(frames):
            complete_s.append(float(delays_s[frames[first]]))
            frames_before.append(first)
    if not complete_s:
        raise CameraError(
            "no frame shows a complete change of the light; shield the rig from other light"
        )
    median_s = float(np.median(complete_s))
    return _CompleteChange(1e3 * median_s, 1e3 * max(complete_s), max(frames_before))


def _rounded_up(value_ms: float) -> float:
    """Round up to 0.01 ms, without a step for the rounding error of a value that is exact."""
    return math.ceil(100.0 * value_ms - 1e-6) / 100.0
