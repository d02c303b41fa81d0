"""Sequences: the controller steps through the lights by itself, one exposure under each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from firmware_sim.firmware import DARK, MAX_STEP_US, MAX_STEPS, MESSAGES
from rig.errors import LightControllerError

if TYPE_CHECKING:  # a configuration plans a sequence, and must be readable without a serial port
    from .driver import Answer, LightController

__all__ = [
    "ClockRelation",
    "LightStep",
    "RunningSequence",
    "SequencePlan",
    "SequenceReport",
    "plan_sequence",
]

# From the end of an exposure until the controller has switched: a turn or two of its main loop,
# and what an optocoupler takes. It is measured in each set; this much is planned for.
REACTION_S = 0.0005
# Two crystals of 50 ppm each, and as much again.
_DRIFT = 2e-4
# Without an edge for so long beyond the frame period, the strobe is not connected.
_STROBE_PATIENCE_S = 0.25


@dataclass(frozen=True)
class SequencePlan:
    """What the controller is asked to do for one set.

    Attributes
    ----------
    lights
        In their order; None is a dark step.
    triggers
        True: the controller steps by time and triggers each exposure; False: the camera runs
        free, and the end of each exposure on its strobe line is a step.
    settle_us
        Least time from a light's change to the exposure that counts.
    wait_us
        With triggers, from one to the next; else how long an edge may be missing.
    frames_per_step
        1, or more if a light has no time to settle between one exposure and the next.
    exposed_s
        From the beginning of the first row's exposure to the end of the last row's.
    duration_s
        From the start to the end, at most, if nothing goes wrong.
    """

    lights: tuple[int | None, ...]
    triggers: bool
    settle_us: int
    wait_us: int
    frames_per_step: int
    exposed_s: float
    duration_s: float

    @property
    def command(self) -> str:
        """The line that starts it."""
        verb = "TRIG" if self.triggers else "ARM"
        order = ",".join(str(DARK if light is None else light) for light in self.lights)
        return f"SEQ:{verb} {self.settle_us},{self.wait_us},{order}"


def plan_sequence(
    light_count: int, *, triggers: bool, settle_s: float, period_s: float, exposed_s: float
) -> SequencePlan:
    """A dark step and one for each light, as fast as lights and camera allow.

    Parameters
    ----------
    light_count
        Lights of the rig.
    triggers
        Whether the controller triggers the camera.
    settle_s
        From the switch until the light is steady.
    period_s
        The camera's frame period; with triggers, the least time between two.
    exposed_s
        From the beginning of the first row's exposure to the end of the last row's.

    Raises
    ------
    ValueError
        If there are too many lights, or no pause between two exposures.
    """
    lights = (None, *range(light_count))
    if len(lights) > MAX_STEPS:
        raise ValueError(f"a sequence has {MAX_STEPS} steps, too few for {light_count} lights")
    busy_s = settle_s + REACTION_S + exposed_s
    if triggers:
        wait_s, frames = max(period_s, busy_s), 1
        duration_s = len(lights) * (wait_s + REACTION_S)
    else:
        if exposed_s + REACTION_S > period_s:
            raise ValueError(
                f"the camera exposes for {1e3 * exposed_s:.4g} ms of a frame period of "
                f"{1e3 * period_s:.4g} ms, and its strobe has no pause; shorten the exposure"
            )
        frames = math.ceil(busy_s / period_s)
        wait_s = max(period_s, settle_s) + _STROBE_PATIENCE_S
        duration_s = (frames * len(lights) + 2) * period_s + settle_s
    settle_us, wait_us = math.ceil(1e6 * settle_s), math.ceil(1e6 * wait_s)
    if wait_us > MAX_STEP_US:
        raise ValueError(f"steps of {wait_s:.3g} s are too long for the controller")
    return SequencePlan(lights, triggers, settle_us, wait_us, frames, exposed_s, duration_s)


@dataclass(frozen=True)
class ClockRelation:
    """The controller's microseconds on the rig's clock, as well as is known.

    An event that the controller stamped happened between sending its command and receiving its
    answer: each exchange bounds the difference of the clocks from both sides.
    """

    offset_s: float
    uncertainty_s: float

    @classmethod
    def of(cls, answers: list[tuple[int, Answer]]) -> ClockRelation:
        """From exchanges in which the controller told its time in microseconds.

        Raises
        ------
        LightControllerError
            If they contradict each other: a clock was set, or started anew.
        """
        span_s = answers[-1][1].received_s - answers[0][1].sent_s
        least_s = max(answer.sent_s - 1e-6 * at_us for at_us, answer in answers)
        most_s = min(answer.received_s - 1e-6 * at_us for at_us, answer in answers)
        slack_s = _DRIFT * span_s
        if least_s > most_s + slack_s:
            raise LightControllerError(
                f"the light controller's clock is off by {1e3 * (least_s - most_s):.3g} ms within "
                f"{span_s:.3g} s; did it restart?"
            )
        return cls(0.5 * (least_s + most_s), 0.5 * abs(most_s - least_s) + slack_s)

    def on_rig_s(self, at_us: int) -> float:
        """A time of the controller on the rig's clock."""
        return self.offset_s + 1e-6 * at_us


@dataclass(frozen=True)
class LightStep:
    """What the controller did in one step, in its own microseconds; None is not.

    `lit_us` is when the light changed, `begun_us` and `ended_us` are the strobe's edges of the
    exposure that counts, `exposures` all that began under this light.
    """

    light: int | None
    lit_us: int
    triggered_us: int | None
    begun_us: int | None
    ended_us: int | None
    exposures: int


@dataclass(frozen=True)
class SequenceReport:
    """A sequence that is over.

    `cause` is why it ended early, None if it did not; `ended_us` is when the LEDs went out.
    """

    steps: tuple[LightStep, ...]
    cause: str | None
    ended_us: int
    clock: ClockRelation


class RunningSequence:
    """A sequence that the controller carries out, from its construction on.

    Raises
    ------
    LightControllerError
        If the controller refuses, because an LED must rest or another sequence runs.
    """

    def __init__(self, lights: LightController, plan: SequencePlan) -> None:
        self._lights = lights
        self._plan = plan
        answer = lights.ask(plan.command, 1)
        self.asked_s = answer.sent_s
        self._started_us = answer.numbers[0]
        self._told = [(self._started_us, answer)]
        self._status: tuple[int, ...] = ()

    def is_running(self) -> bool:
        """Ask whether it still runs; this also keeps the watchdog quiet."""
        answer = self._lights.ask("SEQ:STAT?", 7)
        self._status = answer.numbers
        self._told.append((answer.numbers[6], answer))
        if answer.numbers[4] != self._started_us:
            raise LightControllerError(
                f"{self._lights.port}: the controller knows nothing of the sequence it was given; "
                "did it restart?"
            )
        return bool(answer.numbers[0])

    def report(self) -> SequenceReport:
        """What was done, as it was when `is_running` was asked last."""
        runs, begun, _, code, started_us, passed_us, _ = self._status
        cause = "it still runs" if runs else None
        if code:
            cause = MESSAGES.get(code, f"error {code}")
        return SequenceReport(
            steps=tuple(self._step(index) for index in range(begun)),
            cause=cause,
            ended_us=started_us + passed_us,
            clock=ClockRelation.of(self._told),
        )

    def _step(self, index: int) -> LightStep:
        light, *passed_us, exposures = self._lights.ask(f"SEQ:STEP? {index}", 6).numbers
        lit_us, triggered_us, begun_us, ended_us = (
            None if us < 0 else self._started_us + us for us in passed_us
        )
        if lit_us is None:
            raise LightControllerError(f"{self._lights.port}: step {index} has no time")
        return LightStep(
            None if light == DARK else light, lit_us, triggered_us, begun_us, ended_us, exposures
        )
