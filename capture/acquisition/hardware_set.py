"""Images of a sequence that the light controller runs by itself, also when a part arrives.

The controller records the edges of the camera's strobe, this computer receives the frames. A frame
is assigned to a light only if both agree, in the number of frames from light to light and in time.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from capture.base.errors import SetRejected
from capture.sets.metadata import ImageRecord
from classify.base.errors import InputError
from rig import (
    CameraError,
    Frame,
    HardwareError,
    LightControllerError,
    LightStep,
    Rig,
    RunningSequence,
    SequencePlan,
    SequenceReport,
)
from rig.cameras.config import StampedCameraConfig
from rig.fresh_frame import begin_sequence

from .fresh_frames import SET_SPARE_S, check_frame, light_name
from .light_images import FrameMean, SetImage


class _SequenceFrames:
    """Receives the frames that are exposed after the start of a sequence."""

    def __init__(self, rig: Rig, since_s: float, deadline_s: float) -> None:
        self._rig = rig
        self._since_s = since_s
        self._deadline_s = deadline_s
        self._previous: int | None = None
        self.received: list[Frame] = []

    def take(self) -> bool:
        """Read one more frame; return False if none arrives in time."""
        camera, clock = self._rig.camera, self._rig.clock
        try:
            frame = camera.read(max(0.0, self._deadline_s - clock.now_s()))
        except CameraError:
            if not self.received:
                raise
            return False
        check_frame(frame, camera.info, clock.now_s())
        previous = self._previous
        if previous is not None and frame.sequence <= previous:
            raise SetRejected(
                f"set rejected: frame {frame.sequence} came twice: the camera repeats frames; "
                "check its cable"
            )
        self._previous = frame.sequence
        if self.received and previous is not None and frame.sequence > previous + 1:
            raise SetRejected(
                f"set rejected: frame {previous + 1} was lost; check the camera's cable and the "
                "computer's load"
            )
        if frame.exposure_end_s >= self._since_s:
            self.received.append(frame)
        return True

    def begin(self, since_s: float, deadline_s: float) -> None:
        """Forget the frames that were exposed before `since_s`; read until `deadline_s`."""
        self._since_s, self._deadline_s = since_s, deadline_s
        self.received = [frame for frame in self.received if frame.exposure_end_s >= since_s]

    def at(self, begun_s: float, tolerance_s: float, name: str) -> Frame:
        """The good frame whose exposure began at `begun_s`."""
        delays_s = [frame.exposure_start_s - begun_s for frame in self.received]
        matches = [k for k, delay_s in enumerate(delays_s) if abs(delay_s) <= tolerance_s]
        if len(matches) != 1:
            raise SetRejected(
                f"set rejected: {len(matches)} of {len(delays_s)} frames fit the exposure under "
                f"{name}, the nearest began {1e3 * min(delays_s, key=abs):+.1f} ms from it; if "
                "that stays so, run ps4rig rig latency"
            )
        frame = self.received[matches[0]]
        if frame.is_corrupt:
            raise SetRejected(
                f"set rejected: the frame under {name} is corrupt; check the camera's cable"
            )
        return frame


@dataclass(frozen=True)
class ArrivedPart:
    """A part whose first light is lit already; `capture_set` captures the rest of its set."""

    sequence: RunningSequence
    frames: _SequenceFrames


# Largest distance of a frame's time stamp from the controller's edge, on top of the configured
# uncertainty of the stamps: an optocoupler and an interrupt delay the strobe by far less.
_TOLERANCE_S = 1e-3
# Limit in frame periods of that distance, and of the uncertainty between the clocks. Their sum is
# below one half, so that no frame is confused with its neighbour.
_TOLERANCE_PERIODS = 0.2
# Tolerance of the strobe's pulse against the exposure that the camera reports, which it rounds.
_PULSE_TOLERANCE = 0.02
_PULSE_TOLERANCE_US = 100
# Interval of the queries whether a sequence is over, once all frames are received.
_POLL_S = 0.001


def images_in_sequence(rig: Rig, average: int, part: ArrivedPart | None = None) -> list[SetImage]:
    """Capture ambient and light images as means of `average` sequences.

    The sequence of `part`, if it is given, runs already.
    """
    plan = rig.config.sequence_plan
    if plan is None:
        raise ValueError("the rig is synchronised by software")
    means = [FrameMean(rig.camera.info, average) for _ in plan.lights]
    steps: list[list[LightStep]] = [[] for _ in plan.lights]
    acknowledged_s: list[float] = []
    for _ in range(average):
        frames, report = _run(rig, plan, part)
        acknowledged_s = [report.clock.on_rig_s(step.lit_us) for step in report.steps]
        for index, (frame, step) in enumerate(zip(frames, report.steps, strict=True)):
            means[index].add(frame)
            steps[index].append(step)
    levels = rig.lights.state().levels_percent
    return [
        SetImage(
            mean.image(),
            ImageRecord(
                light=light,
                frames=mean.records,
                led_acknowledged_s=lit_s,
                led_level_percent=None if light is None else levels[light],
                controller_time_us=group[-1].lit_us,
                exposures_us=tuple(
                    (step.begun_us, step.ended_us)
                    for step in group
                    if step.begun_us is not None and step.ended_us is not None
                ),
                triggers_us=tuple(
                    step.triggered_us for step in group if step.triggered_us is not None
                ),
            ),
        )
        for light, mean, group, lit_s in zip(plan.lights, means, steps, acknowledged_s, strict=True)
    ]


def _run(
    rig: Rig, plan: SequencePlan, part: ArrivedPart | None
) -> tuple[list[Frame], SequenceReport]:
    """Run one sequence; return the frame of each step, and the controller's report."""
    if part is None:
        sequence = begin_sequence(rig, plan)
        deadline_s = sequence.sent_s + plan.duration_s + SET_SPARE_S
        frames = _SequenceFrames(rig, sequence.sent_s, deadline_s)
    else:
        sequence, frames = part.sequence, part.frames
    frame_count = plan.frames_per_step * len(plan.lights)
    while len(frames.received) < frame_count or sequence.is_running():
        if plan.triggers and len(frames.received) == frame_count:
            rig.clock.sleep_s(_POLL_S)  # the last step lasts longer than its frame
        elif not frames.take():
            sequence.is_running()  # updates the report, which may name the cause
            break
    report = sequence.report()
    exposures_s, tolerance_s = _exposures_s(rig, plan, report), _tolerance_s(rig, report)
    last_s = exposures_s[-1] - tolerance_s
    while frames.received[-1].exposure_start_s < last_s and frames.take():
        pass
    names = [light_name(rig, light) for light in plan.lights]
    exposed = [
        frames.at(begun_s, tolerance_s, name)
        for begun_s, name in zip(exposures_s, names, strict=True)
    ]
    for (before, after), name in zip(pairwise(exposed), names[1:], strict=True):
        frame_steps = after.sequence - before.sequence
        if frame_steps != plan.frames_per_step:
            raise SetRejected(
                f"set rejected: {frame_steps} frames from the previous light to {name} instead of "
                f"{plan.frames_per_step}: a frame was lost, or the strobe line is noisy; check "
                "both cables"
            )
        previous = frames.received[frames.received.index(after) - 1]
        if np.array_equal(previous.pixels, after.pixels):
            raise SetRejected(
                f"set rejected: the frame under {name} has the pixels of the previous one: the "
                "camera repeats frames; check its cable"
            )
    return exposed, report


def _tolerance_s(rig: Rig, report: SequenceReport) -> float:
    """Largest difference of a frame's time stamp from the controller's record."""
    limit_s = _TOLERANCE_PERIODS * rig.camera.info.frame_period_s
    if report.clock.uncertainty_s > limit_s:
        raise SetRejected(
            "set rejected: the controller's clock is known only to "
            f"{1e3 * report.clock.uncertainty_s:.1f} ms (limit {1e3 * limit_s:.1f} ms), too coarse "
            "to tell frames apart: the serial line or this computer is too slow; stop other "
            "programs"
        )
    camera = rig.config.camera
    assert isinstance(camera, StampedCameraConfig)  # RigConfig plans a sequence for no other
    return min(limit_s, camera.start_uncertainty_s + _TOLERANCE_S) + report.clock.uncertainty_s


def _exposures_s(rig: Rig, plan: SequencePlan, report: SequenceReport) -> list[float]:
    """Exposure start of each step on the rig's clock."""
    stepped_lights = tuple(step.light for step in report.steps)
    if report.cause is not None or stepped_lights != plan.lights:
        raise SetRejected(
            f"set rejected: the sequence ended at step {len(stepped_lights)} of "
            f"{len(plan.lights)}: {report.cause or 'the controller used another order'}; check the "
            "cables of strobe and trigger"
        )
    has_strobe = not plan.triggers or any(step.exposures > 0 for step in report.steps)
    min_us = 1e6 * rig.camera.info.exposure_s * (1.0 - _PULSE_TOLERANCE) - _PULSE_TOLERANCE_US
    max_us = 1e6 * plan.exposed_s * (1.0 + _PULSE_TOLERANCE) + _PULSE_TOLERANCE_US
    changes_us = [*(step.lit_us for step in report.steps[1:]), report.ended_us]
    begun_s: list[float] = []
    for step, changed_us in zip(report.steps, changes_us, strict=True):
        begun_us, ended_us = step.begun_us, step.ended_us
        if not has_strobe and step.triggered_us is not None:
            # The exposure starts at the trigger.
            begun_us, ended_us = step.triggered_us, step.triggered_us + round(1e6 * plan.exposed_s)
        name = light_name(rig, step.light)
        if begun_us is None or ended_us is None:
            raise SetRejected(
                f"set rejected: no complete exposure under {name} on the strobe line; check the "
                "camera's strobe output and its cable"
            )
        if not min_us <= ended_us - begun_us <= max_us:
            raise SetRejected(
                f"set rejected: under {name} the strobe was on for {ended_us - begun_us} us "
                f"instead of {1e6 * rig.camera.info.exposure_s:.0f} us; set the strobe to follow "
                "the exposure, or check the line for noise"
            )
        if begun_us - step.lit_us < plan.settle_us or changed_us < ended_us:
            raise SetRejected(
                f"set rejected: the exposure under {name} began before the light had settled, or "
                "ended after it changed: the controller was late, or the line is noisy; shorten "
                "the exposure, or check the strobe's cable"
            )
        if begun_s and has_strobe and step.exposures != plan.frames_per_step:
            raise SetRejected(
                f"set rejected: {step.exposures} exposures under {name} on the strobe line instead "
                f"of {plan.frames_per_step}: the controller was late, or the line is noisy; "
                "shorten the exposure, or check the strobe's cable"
            )
        begun_s.append(report.clock.on_rig_s(begun_us))
    return begun_s


# Interval of the queries whether the part has come; the controller does not wait for them.
_SENSOR_POLL_S = 0.005


def wait_for_part(
    rig: Rig, delay_s: float, is_stopping: Callable[[], bool] = lambda: False
) -> ArrivedPart | None:
    """Wait until the controller begins the set of a part, `delay_s` after the edge of the sensor.

    Return the part for `capture_set`, or None once `is_stopping`, which is polled, is true.
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
        # Otherwise the controller would wait on, and run the sequence without a receiver.
        with suppress(HardwareError):
            rig.lights.put_out()
        raise


def _arrived_part(
    rig: Rig, plan: SequencePlan, is_stopping: Callable[[], bool], delay_s: float
) -> ArrivedPart | None:
    sequence = begin_sequence(rig, plan, part_delay_s=delay_s)
    frames = _SequenceFrames(rig, sequence.sent_s, sequence.sent_s)
    set_frames = plan.frames_per_step * len(plan.lights)
    while sequence.is_running() and not sequence.has_begun:
        if is_stopping():
            rig.lights.off()
            return None
        if plan.triggers:
            rig.clock.sleep_s(_SENSOR_POLL_S)
            continue
        # A camera that runs free fills its queue. The set may have begun during the latest frames.
        deadline_s = rig.clock.now_s() + rig.camera.info.frame_period_s + SET_SPARE_S
        frames.begin(sequence.sent_s, deadline_s)
        try:
            frames.take()
        except SetRejected:
            # Most likely a fault before the part came. Otherwise the first frame of its set is
            # missing now, and the set will be rejected.
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
