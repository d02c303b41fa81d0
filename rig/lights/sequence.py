"""Sequences: the controller steps through the lights by itself, one exposure under each."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_sim.firmware import DARK, MESSAGES
from rig.config.sequence_plan import SequencePlan
from rig.errors import LightControllerError

from .driver import Answer, LightController

__all__ = ["ClockRelation", "LightStep", "RunningSequence", "SequenceReport"]

# Two crystals of 50 ppm each, and as much again.
_DRIFT = 2e-4


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
