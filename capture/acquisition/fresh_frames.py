"""Fresh frames of one light slot: checks of each frame, exposure times, counts of other frames."""

import math
from collections import Counter, deque

from capture.base.errors import SetRejected
from rig import CameraError, CameraInfo, Frame, Rig, Switch
from rig.config.lights import led_names
from rig.fresh_frame import FrameKind, NoFreshFrameError, kind_of, next_fresh_frame

# Pixels that are compared to find a repeated frame. Noise makes two exposures differ: of 1 DN in
# two thirds of the pixels, of much less in at least one of so many.
_SAMPLED_PX = 4096


def check_frame(frame: Frame, info: CameraInfo, now_s: float) -> None:
    """Reject a frame that the camera did not announce, or that is stamped in the future."""
    rows, columns = frame.pixels.shape
    if (rows, columns, frame.bit_depth) != (info.height_px, info.width_px, info.bit_depth):
        raise CameraError(
            f"the camera sent {columns} x {rows} px of {frame.bit_depth} bit instead of "
            f"{info.width_px} x {info.height_px} px of {info.bit_depth} bit; open it again"
        )
    if not frame.exposure_start_s <= frame.exposure_end_s <= now_s:
        raise CameraError(
            f"frame {frame.sequence} is stamped {frame.exposure_start_s:.6f} to "
            f"{frame.exposure_end_s:.6f} s and arrived at {now_s:.6f} s; the camera's time stamps "
            "are not on the rig's clock: run ps4rig rig latency, or use another camera"
        )


class RepeatDetector:
    """Detects frames that repeat the previous one.

    A frame that comes a third time is accepted: a camera without noise sees a static scene.
    """

    def __init__(self) -> None:
        self._sequence: int | None = None
        self._sample = b""
        self._is_repeat = False

    def is_repeat(self, frame: Frame) -> bool:
        """Whether a frame repeats the one of the previous call."""
        sample = _sample(frame)
        has_old_number = self._sequence is not None and frame.sequence <= self._sequence
        has_old_pixels = sample != b"" and sample == self._sample and not self._is_repeat
        self._is_repeat = has_old_number or has_old_pixels
        self._sequence = max(frame.sequence, self._sequence or 0)
        self._sample = sample
        return self._is_repeat


def _sample(frame: Frame) -> bytes:
    """Pixels spread over the frame; empty for a uniform frame, because dark frames may be equal."""
    pixels = frame.pixels.reshape(-1)
    sample = pixels[:: max(1, pixels.size // _SAMPLED_PX)]
    return sample.tobytes() if int(sample.max()) - int(sample.min()) > 1 else b""


# Largest number of frames from one time stamp to another that it predicts: the buffers of a V4L2
# camera. Over more, the accumulated error of the period exceeds the pause between two exposures.
_MAX_FRAMES = 4
# Relative error of the frame period that a camera reports: `RATE_TOLERANCE` of
# rig/cameras/v4l2/device.py.
_PERIOD_ERROR = 0.01


class ExposureTimeline:
    """Exposure starts of the received frames.

    They are at least a frame period apart, so that time stamps predict the next start, and a later
    stamp can show that an earlier one was late.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._shortest_s = period_s * (1.0 - _PERIOD_ERROR)
        self._last_start_s: float | None = None
        self._received = 0
        # Number of the frame among the received ones, acknowledgement and name of its light.
        self._accepted: deque[tuple[int, float, str]] = deque(maxlen=_MAX_FRAMES)

    @property
    def last_start_s(self) -> float | None:
        """Latest possible start of the last frame by all stamps; None without frames."""
        return self._last_start_s

    def add(self, stamped_start_s: float) -> None:
        """Add the time stamp of the next frame, and check the accepted frames against it."""
        if self._last_start_s is None:
            self._last_start_s = stamped_start_s
        else:
            self._last_start_s = max(stamped_start_s, self._last_start_s + self._shortest_s)
        self._received += 1
        for number, acknowledged_s, name in self._accepted:
            # By the count of received frames: a gap in sequence numbers may not be a lost frame.
            frames = self._received - number
            start_s = stamped_start_s - frames * self._shortest_s
            if frames <= _MAX_FRAMES and start_s < acknowledged_s:
                raise SetRejected(
                    f"set rejected: the time stamp of a frame under {name} was late: the stamps of "
                    f"later frames show that it was exposed {1e3 * (acknowledged_s - start_s):.0f} "
                    "ms or more before the switch; check the camera's cable and the computer's load"
                )

    def accept(self, acknowledged_s: float, name: str) -> None:
        """Mark the last frame as used for the light that was acknowledged at `acknowledged_s`."""
        self._accepted.append((self._received, acknowledged_s, name))

    def next_start_s(
        self, not_before_s: float, start_uncertainty_s: float, max_frames: int
    ) -> float | None:
        """Latest start of the first frame exposed after `not_before_s`; None if it is unknown.

        It is unknown without frames, more than `max_frames` ahead, or if `start_uncertainty_s`
        leaves two frames possible.
        """
        if self._last_start_s is None:
            return None
        frames = max(1, math.ceil((not_before_s - self._last_start_s) / self._period_s))
        error_s = start_uncertainty_s + frames * self._period_s * _PERIOD_ERROR
        start_s = self._last_start_s + frames * self._period_s
        margin_s = start_s - not_before_s
        is_certain = error_s <= margin_s and (frames == 1 or margin_s <= self._period_s - error_s)
        if not is_certain or frames > min(max_frames, _MAX_FRAMES):
            return None
        return start_s + error_s


# As `SPARE_S` of `rig.fresh_frame`, but shorter, because a set has several attempts.
SET_SPARE_S = 0.5


def light_name(rig: Rig, light: int | None) -> str:
    """The name of a light in messages."""
    if light is None:
        return "ambient light"
    return led_names(rig.lighting.tilts_deg)[light]


class FrameHistory:
    """Repeats and exposure times of the frames of one attempt."""

    def __init__(self, period_s: float) -> None:
        self.repeats = RepeatDetector()
        self.timeline = ExposureTimeline(period_s)


class FreshFrames:
    """Frames exposed under the light of one switch.

    `counts` has the number of received frames by kind, `lost_frames` the number of frames that are
    missing between them.
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
        self.lost_frames = 0

    def take(self) -> Frame:
        return self._accepted(self._next())

    def take_exposed_by(self, deadline_s: float) -> Frame | None:
        """Return the next fresh frame; None if its exposure may have ended after the deadline."""
        frame = self._next()
        end_s = self._end_s(self._history.timeline.last_start_s)
        return self._accepted(frame) if end_s is not None and end_s <= deadline_s else None

    def next_end_s(self) -> float | None:
        """Predicted end of the next fresh exposure, last row included; None if unknown."""
        info = self._rig.camera.info
        # The frames before it wait in the queue, which must have a buffer left for it.
        max_frames = info.queue_length - 1
        return self._end_s(
            self._history.timeline.next_start_s(
                self._not_before_s, info.start_uncertainty_s, max_frames
            )
        )

    def _end_s(self, start_s: float | None) -> float | None:
        info = self._rig.camera.info
        if start_s is None or info.readout_s is None:
            return None
        return start_s + info.exposure_s + info.start_uncertainty_s + info.readout_s

    def _accepted(self, frame: Frame) -> Frame:
        self._history.timeline.accept(self._acknowledged_s, light_name(self._rig, self._light))
        return frame

    def _next(self) -> Frame:
        try:
            return next_fresh_frame(self._rig, self._not_before_s, self._count, SET_SPARE_S)
        except NoFreshFrameError as error:
            raise SetRejected(
                f"set rejected: no good frame under {light_name(self._rig, self._light)} "
                f"({error.received}, {self.lost_frames} lost); check the camera's cable, or run "
                "ps4rig rig latency"
            ) from None

    def _count(self, frame: Frame, not_before_s: float) -> FrameKind:
        kind = self._kind_of(frame, not_before_s)
        self.counts[kind] += 1
        return kind

    def _kind_of(self, frame: Frame, not_before_s: float) -> FrameKind:
        check_frame(frame, self._rig.camera.info, self._rig.clock.now_s())
        is_repeat = self._history.repeats.is_repeat(frame)
        if self._last_sequence is not None:
            # A repeated frame may have a number of its own.
            self.lost_frames += max(frame.sequence - self._last_sequence - 1, 0)
            self._last_sequence = max(frame.sequence, self._last_sequence)
        if is_repeat:
            return FrameKind.REPEATED
        self._history.timeline.add(frame.exposure_start_s)
        kind = kind_of(frame, not_before_s)
        self._last_sequence = None if kind is FrameKind.STALE else frame.sequence
        # An ambient image may be all zero, because some cameras clip their noise.
        is_empty = self._light is not None and not frame.pixels.any()
        return FrameKind.CORRUPT if kind is FrameKind.FRESH and is_empty else kind
