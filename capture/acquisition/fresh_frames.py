"""Frames that were exposed under the light that was asked for, and a count of all others."""

from __future__ import annotations

import math
from collections import deque

from capture.errors import SetRejected
from rig import Frame, FrameFlag, Rig, Switch

from .frame_mean import check_frame

__all__ = ["FrameBeat", "FreshFrames", "light_name"]

# Beyond what the frame rate and the driver's queue explain.
_SPARE_S = 0.5
# Pixels by which a frame is known again: noise never falls twice alike on so many.
_FINGERPRINT_PX = 4096
# How many periods back a later frame's time stamp tells an earlier one's, and how exactly the
# camera reports its period.
_BEAT_FRAMES = 4
_PERIOD_ERROR = 0.01
_SHORTEST = 1.0 - _PERIOD_ERROR


def light_name(rig: Rig, light: int | None) -> str:
    """What people call a light."""
    if light is None:
        return "ambient light"
    return f"LED {light} (tilt {rig.lighting.tilts_deg[light]:g})"


class FrameBeat:
    """What the frames of a set know of each other: the even beat of exposures, and their pixels."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._began_s: float | None = None
        self._sequence: int | None = None
        self._received = 0
        self._print = b""
        self._is_repeat = False
        self._accepted: deque[tuple[int, float, str]] = deque(maxlen=_BEAT_FRAMES)

    def is_repeat(self, frame: Frame) -> bool:
        """Whether it is the frame before once more, by its number or by its pixels.

        Of a camera without noise, such as one that plays pictures, all frames are alike. So what
        is alike for the third time is taken.
        """
        print_ = _fingerprint(frame)
        same_number = self._sequence is not None and frame.sequence <= self._sequence
        alike = print_ != b"" and print_ == self._print and not self._is_repeat
        self._is_repeat = same_number or alike
        if not self._is_repeat:
            earlier_s = self._began_s
            self._received += 1
            self._began_s = frame.exposure_start_s
            if earlier_s is not None:
                self._began_s = max(self._began_s, earlier_s + self._period_s * _SHORTEST)
        self._sequence = max(frame.sequence, self._sequence or 0)
        self._print = print_
        return self._is_repeat

    @property
    def began_s(self) -> float | None:
        """When the last frame began, by its time stamp and by those of the frames before it.

        The later of the two, as exposures begin one period apart or more; None without a frame.
        """
        return self._began_s

    def next_start_s(self, not_before_s: float, known_to_s: float, ahead: int) -> float | None:
        """When the first frame will begin that is not older than that, at the latest.

        None where nothing is known of the beat, if it is more than `ahead` frames away, or if two
        frames may be that one, as times are known to `known_to_s`.
        """
        if self._began_s is None:
            return None
        frames = max(1, math.ceil((not_before_s - self._began_s) / self._period_s))
        error_s = known_to_s + frames * self._period_s * _PERIOD_ERROR
        start_s = self._began_s + frames * self._period_s
        newer_s = start_s - not_before_s
        certain = error_s <= newer_s and (frames == 1 or newer_s <= self._period_s - error_s)
        return start_s + error_s if certain and frames <= min(ahead, _BEAT_FRAMES) else None

    def accept(self, acknowledged_s: float, name: str) -> None:
        """Remember that this frame, the last one, was taken for newer than an acknowledge."""
        self._accepted.append((self._received, acknowledged_s, name))

    def check(self, frame: Frame) -> None:
        """See by the time stamp of a later frame whether one that was accepted was that new.

        Exposures begin one period apart or more, so a frame began by as many periods before each
        later one, whatever its own time stamp says.

        Raises
        ------
        SetRejected
            If an accepted frame was older than its light.
        """
        for number, acknowledged_s, name in self._accepted:
            # Those that were received: of numbers that were skipped nobody knows what they count.
            frames = self._received - number
            began_s = frame.exposure_start_s - frames * self._period_s * _SHORTEST
            if 0 < frames <= _BEAT_FRAMES and began_s < acknowledged_s:
                raise SetRejected(
                    f"set rejected: the time stamp of a frame under {name} was late: by those of "
                    f"the frames after it, it began {1e3 * (acknowledged_s - began_s):.0f} ms or "
                    "more before the light; look after the camera's cable and the computer's load"
                )


class FreshFrames:
    """Frames whose exposure began under the light of one switch."""

    def __init__(self, rig: Rig, light: int | None, switch: Switch, beat: FrameBeat) -> None:
        self._rig = rig
        self._light = light
        self._acknowledged_s = switch.acknowledged_s
        self._not_before_s = switch.acknowledged_s + rig.config.lights.settle_ms / 1000.0
        self._beat = beat
        self._previous: int | None = None
        # Gaps before the first frame under this light have nothing to do with this image.
        self._under_light = False
        self.stale = 0
        self.corrupt = 0
        self.repeated = 0
        self.lost = 0

    def take(self) -> Frame:
        """The next good frame; raises what `_next_good` does."""
        return self._accepted(self._next_good())

    def take_exposed_by(self, by_s: float) -> Frame | None:
        """The next good frame, or None if light may have fallen on it after `by_s`.

        Its exposure has an end that is known, see `next_end_s`. Raises what `take` does.
        """
        frame = self._next_good()
        end_s = self._end_s(self._beat.began_s)
        return self._accepted(frame) if end_s is not None and end_s <= by_s else None

    def next_end_s(self) -> float | None:
        """When a good frame is going to have been exposed, to its last row; None if not known."""
        info = self._rig.camera.info
        # Those before it wait in the queue, where there must be room for it.
        ahead = info.queue_length - 1
        return self._end_s(
            self._beat.next_start_s(self._not_before_s, info.start_known_to_s, ahead)
        )

    def _end_s(self, start_s: float | None) -> float | None:
        info = self._rig.camera.info
        if start_s is None or info.readout_s is None:
            return None
        return start_s + info.exposure_s + info.start_known_to_s + info.readout_s

    def _accepted(self, frame: Frame) -> Frame:
        self._beat.accept(self._acknowledged_s, light_name(self._rig, self._light))
        return frame

    def _next_good(self) -> Frame:
        """The next frame that is newer than the light, not corrupt and not empty.

        Raises
        ------
        SetRejected
            If none comes in the time that the queue and the frame rate account for.
        CameraError
            If the camera gives no frame at all in that time.
        """
        info = self._rig.camera.info
        clock = self._rig.clock
        frames_s = (info.queue_length + 2) * info.frame_period_s + info.exposure_s
        settle_s = self._rig.config.lights.settle_ms / 1000.0
        patience_s = frames_s + settle_s + _SPARE_S
        deadline_s = clock.now_s() + patience_s
        while clock.now_s() < deadline_s:
            # Not only what remains: a camera that gives bad frames has not failed to give any.
            frame = self._rig.camera.read(patience_s)
            check_frame(frame, info, clock.now_s())
            if self._beat.is_repeat(frame):
                self.repeated += 1
                continue
            self._beat.check(frame)
            if self._previous is not None and self._under_light:
                self.lost += frame.sequence - self._previous - 1
            self._previous = frame.sequence
            self._under_light = frame.exposure_start_s >= self._not_before_s
            if not self._under_light:
                self.stale += 1
            elif frame.flags != FrameFlag.GOOD or self._is_empty(frame):
                self.corrupt += 1
            else:
                return frame
        raise SetRejected(
            f"set rejected: no good frame under {light_name(self._rig, self._light)} in "
            f"{patience_s:.1f} s ({self.stale} from before the switch, {self.corrupt} corrupt or "
            f"empty, {self.repeated} repeated, {self.lost} lost)"
        )

    def _is_empty(self, frame: Frame) -> bool:
        """Whether there is nothing in it. Without light a camera may cut its noise off at zero."""
        return self._light is not None and not frame.pixels.any()


def _fingerprint(frame: Frame) -> bytes:
    """Some of its pixels; nothing if they are all alike, as they may be in the dark."""
    pixels = frame.pixels.reshape(-1)
    sample = pixels[:: max(1, pixels.size // _FINGERPRINT_PX)]
    return sample.tobytes() if int(sample.max()) - int(sample.min()) > 1 else b""
