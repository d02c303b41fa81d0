"""Record the frames around switches of an LED, and evaluate the light in them."""

import random
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from classify.base.arrays import BoolArray, Floats, Indices
from rig.acceptance import MAX_SATURATED_SHARE
from rig.cameras.camera import Frame, FrameFlag
from rig.errors import CameraError
from rig.fresh_frame import frames_until_fresh, next_fresh_frame, switch_to
from rig.rig import Rig

from .fit import StepFit, Steps, fit_steps

# Bands of rows in a frame: more make the fit slower, fewer the readout less certain.
_BANDS = 32
# Periods of frames recorded after a step, on top of stale frames: the step and its end.
_PERIODS_AFTER = 2.0
# Least change of a band's light as a share of the range: with less, noise dominates.
_MIN_CONTRAST = 0.01
# Drift of the controller's crystal against this computer's: common crystals have 50 ppm.
_CLOCK_DRIFT = 5e-5
# Number of exchanges before and after each one whose bounds are combined: enough that one of them
# is fast, few enough that the clocks hardly drift.
_NEIGHBOURS = 8
# The second half of the switches may miss an exposure by this share of it, because its ends are
# known only roughly after the first half.
_AIM_BEYOND = 0.1


@dataclass
class Recording:
    """Switches, and for each frame its times and the light in each band of its rows."""

    # s: command, acknowledge, switch; turned on
    switches: list[tuple[float, float, float, bool]] = field(default_factory=list)
    reported_s: list[float] = field(default_factory=list)
    arrived_s: list[float] = field(default_factory=list)
    of_step: list[int] = field(default_factory=list)
    levels: list[Floats] = field(default_factory=list)  # (B,) each


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Result of evaluating a `Recording`."""

    steps: Steps
    fit: StepFit
    of_step: Indices  # (F,) number of each frame's switch
    after_s: Floats  # (F,) arrival of each frame after the acknowledge
    delay_s: float  # from the command to the switch
    unknown_s: float  # uncertainty of the times of the switches

    def wait_s(self, place: float, now_s: float, reported_s: float) -> float:
        """Time until a command switches at `place`, 0 to 1, of a coming exposure."""
        place_s = ((1.0 + 2.0 * _AIM_BEYOND) * place - _AIM_BEYOND) * (
            self.steps.exposure_s + self.fit.readout_s
        )
        due_s = reported_s + self.fit.start_s - self.delay_s + place_s
        return (due_s - now_s) % self.steps.period_s


def record_steps(rig: Rig, led: int, numbers: Iterable[int], count: int) -> Recording:
    """Record every frame from each switch, first at all phases, then aimed at the exposures."""
    info, clock, recording = rig.camera.info, rig.clock, Recording()
    rng = random.Random(1)
    after_s = rig.config.lights.settle_ms / 1e3 + _PERIODS_AFTER * info.frame_period_s
    # One switch in each part of the period, in random order, so that no phase is missed.
    parts = [part for _ in range(2) for part in rng.sample(range(count // 2), count // 2)]
    dark_s = rig.lights.off().acknowledged_s
    next_fresh_frame(rig, dark_s + after_s)
    half: Evaluation | None = None
    for number in numbers:
        if number == count // 2:
            half = evaluate(rig, recording)
        place = (parts[number] + rng.random()) / (count // 2)
        if half is None:
            clock.sleep_s(place * info.frame_period_s)
        else:
            clock.sleep_s(half.wait_s(place, clock.now_s(), recording.reported_s[-1]))
        asked_s, rising = clock.now_s(), number % 2 == 0
        switch = switch_to(rig, led if rising else None)
        controller_s = switch.controller_time_us / 1e6
        recording.switches.append((asked_s, switch.acknowledged_s, controller_s, rising))
        for frame, _ in frames_until_fresh(rig, switch.acknowledged_s + after_s):
            if frame.flags != FrameFlag.GOOD:
                continue
            recording.reported_s.append(frame.exposure_start_s)
            recording.arrived_s.append(clock.now_s())
            recording.of_step.append(number)
            recording.levels.append(_band_levels(frame))
        rig.lights.confirm(led if rising else None)
    rig.lights.off()
    return recording


def evaluate(rig: Rig, recording: Recording) -> Evaluation:
    """Evaluate the frames recorded so far."""
    info, of_step = rig.camera.info, np.array(recording.of_step)
    asked_s, acknowledged_s, controller_s, rising = map(
        np.array, zip(*recording.switches, strict=True)
    )
    switched_s, unknown_s = _switch_times(asked_s, acknowledged_s, controller_s)
    shares, kept = _shares(np.array(recording.levels), of_step, rising, 1 << info.bit_depth)
    edges = _band_edges(info.height_px)
    steps = Steps(
        reported_s=np.array(recording.reported_s) - switched_s[of_step],
        rising=rising[of_step],
        shares=shares,
        bands=((edges[:-1] + edges[1:] - 1.0) / 2.0 / (info.height_px - 1))[kept],
        exposure_s=info.exposure_s,
        period_s=info.frame_period_s,
    )
    return Evaluation(
        steps,
        fit_steps(steps),
        of_step,
        after_s=np.array(recording.arrived_s) - acknowledged_s[of_step],
        delay_s=float(np.median(switched_s - asked_s)),
        unknown_s=unknown_s,
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


def _switch_times(asked: Floats, answered: Floats, theirs: Floats) -> tuple[Floats, float]:
    """Time of each switch on the rig's clock, and the uncertainty."""
    switched, unknown_s = np.empty(len(asked)), 0.0
    for index in range(len(asked)):
        near = slice(max(index - _NEIGHBOURS, 0), index + _NEIGHBOURS + 1)
        low, high = float((asked - theirs)[near].max()), float((answered - theirs)[near].min())
        drift_s = _CLOCK_DRIFT * float(answered[near].max() - asked[near].min())
        if low > high + drift_s:
            # The clock was set or restarted: only the bounds of this exchange hold.
            low, high = asked[index] - theirs[index], answered[index] - theirs[index]
        switched[index] = theirs[index] + (low + high) / 2.0
        unknown_s = max(unknown_s, abs(high - low) / 2.0 + drift_s)
    return switched, unknown_s


def _shares(
    levels: Floats, of_step: Indices, rising: BoolArray, values: int
) -> tuple[Floats, BoolArray]:
    """(F, B) share of the LED's light in each band, and which of all bands show it."""
    last = np.append(np.diff(of_step) > 0, True)
    lit = np.median(levels[last & rising[of_step]], axis=0)
    dark = np.median(levels[last & ~rising[of_step]], axis=0)
    kept = lit - dark > _MIN_CONTRAST * values
    if np.count_nonzero(kept) < 2:
        raise CameraError(
            "the LED makes no difference in the frames; choose an LED that works, and put a bright "
            "surface below the camera"
        )
    return (levels[:, kept] - dark[kept]) / (lit - dark)[kept], kept
