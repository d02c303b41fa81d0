"""Wait for a frame that was exposed after a switch of the lights."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import Enum

from .cameras.camera import Frame
from .config.lights import SequencePlan
from .errors import CameraError, LightControllerError
from .lights.driver import Switch
from .lights.sequence import RunningSequence, exposure_left_s
from .rig import Rig

# Margin on the time that the frames of the queue take: for a camera that has just started to stream
# or a busy computer. A longer one only delays the error message.
SPARE_S = 2.0
# Frames to wait for besides those in the queue: one in transfer, one that is exposed during the
# switch, and the fresh one.
FRAMES_BESIDES_QUEUE = 3
_POLL_S = 0.001  # interval between two questions whether a sequence still runs


class FrameKind(Enum):
    """Kinds of frames while waiting for a fresh one, with their names in messages."""

    FRESH = "fresh"
    STALE = "from before the switch"
    CORRUPT = "corrupt or empty"
    REPEATED = "repeated"


class NoFreshFrameError(CameraError):
    """The camera delivers frames, but no fresh one."""

    def __init__(self, counts: Counter[FrameKind], waited_s: float) -> None:
        frames = ", ".join(f"{count} {kind.value}" for kind, count in counts.items())
        self.received = f"{frames} in {waited_s:.1f} s"
        super().__init__(
            f"no fresh frame after a switch of the lights ({self.received}); run ps4rig rig "
            "latency to measure what the camera's time stamps mean; if they are not on the rig's "
            "clock, use another camera"
        )


def switch_to(rig: Rig, light: int | None) -> Switch:
    """Turn on one light and no other; None turns all off."""
    return rig.lights.off() if light is None else rig.lights.select(light)


def fresh_frame(rig: Rig, light: int | None) -> Frame:
    """Switch to `light` (None: all off) and return the first good frame exposed under it."""
    plan = rig.config.sequence_plan
    if plan is not None and plan.triggers:
        return _triggered_frame(rig, replace(plan, lights=(light,)))
    switch = switch_to(rig, light)
    settled_s = switch.acknowledged_s + rig.config.lights.settle_ms / 1e3
    frame = next_fresh_frame(rig, settled_s)
    rig.lights.confirm(light)
    return frame


def begin_sequence(
    rig: Rig, plan: SequencePlan, *, part_delay_s: float | None = None
) -> RunningSequence:
    """Start a sequence after the exposure that an aborted one left running."""
    if plan.triggers:
        rig.clock.sleep_s(exposure_left_s(rig.lights, plan))
    return RunningSequence(rig.lights, plan, part_delay_s=part_delay_s)


def _triggered_frame(rig: Rig, plan: SequencePlan) -> Frame:
    """The frame of a sequence of one step, which triggers the camera."""
    sequence = begin_sequence(rig, plan)
    frame = next_fresh_frame(rig, sequence.sent_s)
    while sequence.is_running():
        rig.clock.sleep_s(_POLL_S)  # the step lasts longer than its frame
    cause = sequence.report().cause
    if cause is not None:
        raise LightControllerError(f"{rig.lights.port}: the light went out early: {cause}")
    return frame


def kind_of(frame: Frame, not_before_s: float) -> FrameKind:
    """The kind of a frame by its time stamp and error alone."""
    if not frame.exposure_start_s >= not_before_s:  # also a stamp that is NaN
        return FrameKind.STALE
    return FrameKind.CORRUPT if frame.is_corrupt else FrameKind.FRESH


def next_fresh_frame(
    rig: Rig,
    not_before_s: float,
    classify: Callable[[Frame, float], FrameKind] = kind_of,
    spare_s: float = SPARE_S,
) -> Frame:
    """Return the first fresh frame, with the parameters and errors of `frames_until_fresh`."""
    frames = frames_until_fresh(rig, not_before_s, classify, spare_s)
    return next(frame for frame, kind in frames if kind is FrameKind.FRESH)


def frames_until_fresh(
    rig: Rig,
    not_before_s: float,
    classify: Callable[[Frame, float], FrameKind] = kind_of,
    spare_s: float = SPARE_S,
) -> Iterator[tuple[Frame, FrameKind]]:
    """Read frames up to and including the first one exposed after `not_before_s`."""
    info, started_s = rig.camera.info, rig.clock.now_s()
    frame_count = info.queue_length + FRAMES_BESIDES_QUEUE
    frames_s = frame_count * info.frame_period_s + info.exposure_s
    timeout_s = max(not_before_s - started_s, 0.0) + frames_s + spare_s
    counts: Counter[FrameKind] = Counter()
    # Also read the frames that were queued while a busy computer did not run this program.
    while rig.clock.now_s() < started_s + timeout_s or counts.total() < frame_count:
        # The full time for each read: after a stale frame the camera may still be slow.
        frame = rig.camera.read(timeout_s)
        kind = classify(frame, not_before_s)
        counts[kind] += 1
        yield frame, kind
        if kind is FrameKind.FRESH:
            return
    raise NoFreshFrameError(counts, rig.clock.now_s() - started_s)
