"""The part sensor: the controller begins a set by itself when a part arrives."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from capture.base.errors import SetRejected
from classify.base.errors import InputError
from rig import HardwareError, LightControllerError, Rig, RunningSequence, SequencePlan
from rig.fresh_frame import begin_sequence

from .fresh_frames import SET_SPARE_S
from .sequence_frames import SequenceFrames

# Interval of the queries whether the part has come; the controller does not wait for them.
_POLL_S = 0.005


@dataclass(frozen=True)
class ArrivedPart:
    """A part whose first light is lit already; `capture_set` captures the rest of its set."""

    sequence: RunningSequence
    frames: SequenceFrames


def wait_for_part(
    rig: Rig, delay_s: float, is_stopping: Callable[[], bool] = lambda: False
) -> ArrivedPart | None:
    """Wait until the controller has begun the set of a part, `delay_s` after the sensor's edge.

    Give the part to `capture_set` at once; None if `is_stopping`, which is polled, ended the wait.
    """
    plan = rig.config.sequence_plan
    if plan is None:
        raise InputError(
            "a part sensor needs lights.synchronisation = 'strobe' or 'trigger' in rig.toml"
        )
    rig.lights.recover()
    try:
        return _arrived_part(rig, plan, is_stopping, delay_s)
    except BaseException:
        # The controller would still wait for the part, and light it with nobody looking.
        with suppress(HardwareError):
            rig.lights.put_out()
        raise


def _arrived_part(
    rig: Rig, plan: SequencePlan, is_stopping: Callable[[], bool], delay_s: float
) -> ArrivedPart | None:
    sequence = begin_sequence(rig, plan, part_delay_s=delay_s)
    frames = SequenceFrames(rig, sequence.asked_s, sequence.asked_s)
    set_frames = plan.frames_per_step * len(plan.lights)
    while sequence.is_running() and not sequence.has_begun:
        if is_stopping():
            rig.lights.off()
            return None
        if plan.triggers:
            rig.clock.sleep_s(_POLL_S)
            continue
        # The camera runs freely. The set may have begun during the latest frames.
        deadline_s = rig.clock.now_s() + rig.camera.info.frame_period_s + SET_SPARE_S
        frames.begin(sequence.asked_s, deadline_s)
        try:
            frames.take()
        except SetRejected:
            # A fault before the part. If the set has begun already, its first frame is missing.
            frames.received.clear()
        del frames.received[:-set_frames]
    if not sequence.has_begun:
        raise LightControllerError(
            f"{rig.lights.port}: the controller ended the wait for a part: "
            f"{sequence.report().cause}"
        )
    begun_s = sequence.begun_s()
    frames.begin(begun_s, begun_s + plan.duration_s + SET_SPARE_S)
    return ArrivedPart(sequence, frames)
