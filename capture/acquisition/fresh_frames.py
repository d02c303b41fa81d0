"""Fresh frames of one light slot, and counts of all other frames."""

from collections import Counter

from capture.base.errors import SetRejected
from rig import Frame, Rig, Switch
from rig.fresh_frame import FrameKind, NoFreshFrameError, kind_of, next_fresh_frame

from .exposure_timeline import ExposureTimeline
from .frame_checks import RepeatDetector, check_frame

# Time to wait for a frame beyond what frame rate and queue explain. It is shorter than that of
# `rig.fresh_frame`, because a set has several attempts.
SET_SPARE_S = 0.5


def light_name(rig: Rig, light: int | None) -> str:
    """The name of a light in messages."""
    if light is None:
        return "ambient light"
    return f"LED {light} (tilt {rig.lighting.tilts_deg[light]:g})"


class FrameHistory:
    """Repeats and exposure times of the frames of one attempt."""

    def __init__(self, period_s: float) -> None:
        self.repeats = RepeatDetector()
        self.timeline = ExposureTimeline(period_s)


class FreshFrames:
    """Frames that were exposed under the light of one switch.

    `counts` holds the frames received by kind, `lost` the gaps in their sequence numbers.
    """

    def __init__(self, rig: Rig, light: int | None, switch: Switch, history: FrameHistory) -> None:
        self._rig = rig
        self._light = light
        self._acknowledged_s = switch.acknowledged_s
        self._not_before_s = switch.acknowledged_s + rig.config.lights.settle_ms / 1000.0
        self._history = history
        # None until the first fresh frame: an earlier gap does not affect the image.
        self._last_sequence: int | None = None
        self.counts: Counter[FrameKind] = Counter()
        self.lost = 0

    def take(self) -> Frame:
        return self._accepted(self._next())

    def take_exposed_by(self, by_s: float) -> Frame | None:
        """Return the next fresh frame, or None if its exposure may have ended after `by_s`."""
        frame = self._next()
        end_s = self._end_s(self._history.timeline.last_start_s)
        return self._accepted(frame) if end_s is not None and end_s <= by_s else None

    def next_end_s(self) -> float | None:
        """Predicted end of the next fresh exposure, last row included; None if unknown."""
        info = self._rig.camera.info
        # The frames before it wait in the queue, which must have a buffer left for it.
        max_frames = info.queue_length - 1
        return self._end_s(
            self._history.timeline.next_start_s(
                self._not_before_s, info.start_known_to_s, max_frames
            )
        )

    def _end_s(self, start_s: float | None) -> float | None:
        info = self._rig.camera.info
        if start_s is None or info.readout_s is None:
            return None
        return start_s + info.exposure_s + info.start_known_to_s + info.readout_s

    def _accepted(self, frame: Frame) -> Frame:
        self._history.timeline.accept(self._acknowledged_s, light_name(self._rig, self._light))
        return frame

    def _next(self) -> Frame:
        try:
            return next_fresh_frame(self._rig, self._not_before_s, self._receive, SET_SPARE_S)
        except NoFreshFrameError as error:
            raise SetRejected(
                f"set rejected: no good frame under {light_name(self._rig, self._light)} "
                f"({error.found}, {self.lost} lost); check the camera's cable, or run ps4rig rig "
                "latency"
            ) from None

    def _receive(self, frame: Frame, not_before_s: float) -> FrameKind:
        kind = self._kind_of(frame, not_before_s)
        self.counts[kind] += 1
        return kind

    def _kind_of(self, frame: Frame, not_before_s: float) -> FrameKind:
        check_frame(frame, self._rig.camera.info, self._rig.clock.now_s())
        is_repeat = self._history.repeats.is_repeat(frame)
        if self._last_sequence is not None:
            # A repeated frame may have a number of its own.
            self.lost += max(frame.sequence - self._last_sequence - 1, 0)
            self._last_sequence = max(frame.sequence, self._last_sequence)
        if is_repeat:
            return FrameKind.REPEATED
        self._history.timeline.add(frame.exposure_start_s)
        kind = kind_of(frame, not_before_s)
        self._last_sequence = None if kind is FrameKind.STALE else frame.sequence
        # An ambient image may be all zero, because some cameras clip their noise.
        is_empty = self._light is not None and not frame.pixels.any()
        return FrameKind.CORRUPT if kind is FrameKind.FRESH and is_empty else kind
