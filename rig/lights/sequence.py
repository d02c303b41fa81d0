"""Sequences: the controller steps through the lights, one exposure under each."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from classify.base.errors import ConfigError
from firmware_sim.firmware import DARK, MAX_LINE_BYTES, MAX_SEQUENCE, MESSAGES
from rig.config.lights import SequencePlan
from rig.errors import LightControllerError

from .driver import Answer, LightController
from .link import encode_command

# Drift between the clocks: two crystals of 50 ppm each, doubled for temperature and age.
_DRIFT = 2e-4
# Number of latest exchanges that relate the clocks, for a sequence that waits for hours.
_EXCHANGES = 1000


def start_command(plan: SequencePlan) -> str:
    """Return the command that starts a sequence."""
    verb = "TRIG" if plan.triggers else "ARM"
    order = ",".join(str(DARK if light is None else light) for light in plan.lights)
    return f"SEQ:{verb} {plan.settle_us},{plan.wait_us},{order}"


def require_short_command(plan: SequencePlan) -> None:
    """Check that the command of a sequence fits into a line of the controller."""
    line = encode_command(MAX_SEQUENCE, start_command(plan)).removesuffix(b"\n")
    if len(line) > MAX_LINE_BYTES:
        raise ConfigError(
            f"the controller's command for {len(plan.lights) - 1} lights has more than "
            f"{MAX_LINE_BYTES} bytes; set lights.synchronisation = 'software'"
        )


def exposure_left_s(lights: LightController, plan: SequencePlan) -> float:
    """Seconds for which an exposure of an aborted sequence of `plan` may still run."""
    status = _Status(*_ask_status(lights).numbers)
    if not status.error_code:
        return 0.0
    return max(0.0, 1e-6 * (status.ended_us + plan.wait_us - status.now_us))


def detected_part_count(lights: LightController) -> int:
    """Return the number of parts that the sensor has detected since the controller booted."""
    return lights.ask("PART:STAT?", 3).numbers[0]


class _Status(NamedTuple):
    """The numbers of ``SEQ:STAT?``; times in the controller's microseconds."""

    is_running: int
    begun_steps: int
    all_steps: int
    error_code: int  # of an early end; 0 without
    started_us: int
    duration_us: int
    now_us: int

    @property
    def ended_us(self) -> int:
        return self.started_us + self.duration_us


def _ask_status(lights: LightController) -> Answer:
    return lights.ask("SEQ:STAT?", len(_Status._fields))


DatedAnswer = tuple[int, Answer]
"""Time of the controller in microseconds, and the answer that had it."""


@dataclass(frozen=True)
class ClockRelation:
    """The controller's microseconds on the rig's clock: each exchange bounds their difference."""

    offset_s: float
    uncertainty_s: float

    @classmethod
    def of(cls, answers: Sequence[DatedAnswer], drift: float = _DRIFT) -> ClockRelation:
        """Relate the clocks by exchanges; `drift` is the largest relative one between them."""
        span_s = answers[-1][1].received_s - answers[0][1].sent_s
        lower_s = max(answer.sent_s - 1e-6 * at_us for at_us, answer in answers)
        upper_s = min(answer.received_s - 1e-6 * at_us for at_us, answer in answers)
        slack_s = drift * span_s
        if lower_s > upper_s + slack_s:
            raise LightControllerError(
                f"the light controller's clock is off by {1e3 * (lower_s - upper_s):.3g} ms within "
                f"{span_s:.3g} s; did it restart?"
            )
        return cls(0.5 * (lower_s + upper_s), 0.5 * abs(upper_s - lower_s) + slack_s)

    def on_rig_s(self, at_us: int) -> float:
        """Convert a time of the controller to the rig's clock."""
        return self.offset_s + 1e-6 * at_us


@dataclass(frozen=True)
class LightStep:
    """The controller's record of one step; times in its own microseconds, None if missing.

    `lit_us` is the change of the light; `begun_us` and `ended_us` are the strobe's edges of the
    exposure that counts; `exposures` is the number of exposures that began under this light.
    """

    light: int | None
    lit_us: int
    triggered_us: int | None
    begun_us: int | None
    ended_us: int | None
    exposures: int


@dataclass(frozen=True)
class SequenceReport:
    """The record of a sequence that has ended.

    `cause` is the reason for an early end, None after the last step. The LEDs went out at
    `ended_us`.
    """

    steps: tuple[LightStep, ...]
    cause: str | None
    ended_us: int
    clock: ClockRelation


class RunningSequence:
    """A sequence that the controller runs; constructing it starts the sequence.

    With `part_delay_s` it waits until the part sensor has detected a part and this time has passed.
    `is_running` has to be called during the wait, or the watchdog ends it.

    Raises
    ------
    LightControllerError
        If the controller refuses because an LED must rest or another sequence runs.
    """

    def __init__(
        self, lights: LightController, plan: SequencePlan, *, part_delay_s: float | None = None
    ) -> None:
        self._lights = lights
        if part_delay_s is not None:
            lights.ask(f"PART:WAIT {round(1e6 * part_delay_s)}", 1)
        answer = lights.ask(start_command(plan), 1)
        self.sent_s = answer.sent_s
        self._started_us = answer.numbers[0]
        self._dated_answers: deque[DatedAnswer] = deque([(self._started_us, answer)], _EXCHANGES)
        self._status: _Status | None = None

    def is_running(self) -> bool:
        """Ask whether the sequence still runs, which also keeps the watchdog quiet."""
        answer = _ask_status(self._lights)
        status = self._status = _Status(*answer.numbers)
        self._dated_answers.append((status.now_us, answer))
        if status.started_us != self._started_us:
            raise LightControllerError(
                f"{self._lights.port}: the controller does not know the sequence that was started; "
                "did it restart?"
            )
        return bool(status.is_running)

    @property
    def has_begun(self) -> bool:
        """Whether its first light was lit, as of the last `is_running`."""
        return self._status is not None and self._status.begun_steps > 0

    def begun_s(self) -> float:
        """Time at which its first light was lit, on the rig's clock."""
        return ClockRelation.of(self._dated_answers).on_rig_s(self._step(0).lit_us)

    def report(self) -> SequenceReport:
        """Return the record as of the last `is_running`, which must have been called."""
        status = self._status
        assert status is not None
        cause = "it still runs" if status.is_running else None
        if status.error_code:
            cause = MESSAGES.get(status.error_code, f"error {status.error_code}")
        return SequenceReport(
            steps=tuple(self._step(index) for index in range(status.begun_steps)),
            cause=cause,
            ended_us=status.ended_us,
            clock=ClockRelation.of(self._dated_answers),
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
