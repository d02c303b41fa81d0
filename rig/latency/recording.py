"""Switching an LED against the frames of a camera, and what the frames had of it."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from rig.camera import Frame, FrameFlag
from rig.errors import CameraError
from rig.fresh_frame import frames_until_fresh, next_fresh_frame, switch_to
from rig.rig import Rig

from .fit import StepFit, Steps, fit_steps

__all__ = ["Recording", "Seen", "evaluate", "record_steps"]

Floats = npt.NDArray[np.float64]

_BANDS = 32
# Periods of frames looked at after a step, beyond those that may be older than it.
_PERIODS_AFTER = 2.0
# A band whose light changes by less than this share of the range says nothing.
_LEAST_CONTRAST = 0.01
_MOST_SATURATED = 0.01
# Quartz against quartz.
_CLOCK_DRIFT = 5e-5
_NEIGHBOURS = 8
# Of an exposure, how far it is aimed beyond its ends.
_BEYOND = 0.1


@dataclass(frozen=True)
class _Step:
    asked_s: float
    acknowledged_s: float
    controller_s: float
    rising: bool


@dataclass
class Recording:
    """Switches, and frames as they came with the light in bands of their rows."""

    switches: list[_Step] = field(default_factory=list)
    reported_s: list[float] = field(default_factory=list)
    came_s: list[float] = field(default_factory=list)
    of_step: list[int] = field(default_factory=list)
    levels: list[Floats] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Seen:
    """What a recording tells; `delay_s` is from the question to the switch."""

    steps: Steps
    fit: StepFit
    of_step: npt.NDArray[np.intp]
    after_s: Floats
    delay_s: float
    unknown_s: float


@dataclass(frozen=True)
class _Aim:
    """When to ask, so that the switch falls into an exposure."""

    after_report_s: float
    exposed_s: float
    period_s: float

    @classmethod
    def at(cls, seen: Seen) -> _Aim:
        exposed_s = seen.steps.exposure_s + seen.fit.readout_s
        # A little beyond both ends: where they are is known only roughly.
        return cls(
            seen.fit.start_s - seen.delay_s - _BEYOND * exposed_s,
            (1.0 + 2.0 * _BEYOND) * exposed_s,
            seen.steps.period_s,
        )

    def wait_s(self, place: float, now_s: float, reported_s: float) -> float:
        """From now to `place`, 0 to 1, in an exposure that is to come."""
        due_s = reported_s + self.after_report_s + place * self.exposed_s
        return (due_s - now_s) % self.period_s


def record_steps(
    rig: Rig, led: int, numbers: Iterable[int], count: int, rng: random.Random
) -> Recording:
    """Every frame from each switch until the change must be long over.

    The first half of the switches are at all phases of the frames. Where exposures are short few
    of them fall into one, so the others are aimed at the exposures that the first half has found.
    """
    info, clock, recording = rig.camera.info, rig.clock, Recording()
    after_s = rig.config.lights.settle_ms / 1e3 + _PERIODS_AFTER * info.frame_period_s
    # One in each part, in no order, so that no phase is missed.
    parts = [part for _ in range(2) for part in rng.sample(range(count // 2), count // 2)]
    dark_s = rig.lights.off().acknowledged_s
    next_fresh_frame(rig, dark_s + after_s)
    aim: _Aim | None = None
    for number in numbers:
        if number == count // 2:
            aim = _Aim.at(evaluate(rig, recording))
        place = (parts[number] + rng.random()) / (count // 2)
        if aim is None:
            clock.sleep_s(place * info.frame_period_s)
        else:
            clock.sleep_s(aim.wait_s(place, clock.now_s(), recording.reported_s[-1]))
        asked_s, rising = clock.now_s(), number % 2 == 0
        switch = switch_to(rig, led if rising else None)
        recording.switches.append(
            _Step(asked_s, switch.acknowledged_s, switch.controller_time_us / 1e6, rising)
        )
        for frame, _ in frames_until_fresh(rig, switch.acknowledged_s + after_s):
            if frame.flags != FrameFlag.GOOD:
                continue
            recording.reported_s.append(frame.exposure_start_s)
            recording.came_s.append(clock.now_s())
            recording.of_step.append(number)
            recording.levels.append(_band_levels(frame))
        rig.lights.confirm(led if rising else None)
    rig.lights.off()
    return recording


def evaluate(rig: Rig, recording: Recording) -> Seen:
    """What the frames so far tell."""
    info, switches = rig.camera.info, recording.switches
    switched_s, unknown_s = _switch_times(switches)
    of_step = np.array(recording.of_step)
    rising = np.array([step.rising for step in switches])
    shares, kept = _shares(np.array(recording.levels), of_step, rising, 1 << info.bit_depth)
    steps = Steps(
        reported_s=np.array(recording.reported_s) - switched_s[of_step],
        rising=rising[of_step],
        shares=shares,
        bands=_band_places(info.height_px)[kept],
        exposure_s=info.exposure_s,
        period_s=info.frame_period_s,
    )
    asked_s, acknowledged_s = (
        np.array([getattr(step, name) for step in switches])
        for name in ("asked_s", "acknowledged_s")
    )
    return Seen(
        steps,
        fit_steps(steps),
        of_step,
        after_s=np.array(recording.came_s) - acknowledged_s[of_step],
        delay_s=float(np.median(switched_s - asked_s)),
        unknown_s=unknown_s,
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
