"""Exposure times of the frames of a set, from all their time stamps together."""

import math
from collections import deque

from capture.base.errors import SetRejected

# Frames over which one time stamp bounds another: the buffers of a V4L2 camera. Over more frames,
# the error of the period is larger than the pause between two exposures.
_MAX_FRAMES = 4
# Relative error of the frame period that a camera reports: `RATE_TOLERANCE` of
# rig/cameras/v4l2/device.py.
_PERIOD_ERROR = 0.01


class ExposureTimeline:
    """Exposure starts of the frames received so far.

    Exposures start at least one frame period apart: the stamps of earlier frames predict the next
    start, and the stamps of later frames show that an earlier one was too late.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._shortest_s = period_s * (1.0 - _PERIOD_ERROR)
        self._last_start_s: float | None = None
        self._received = 0
        self._accepted: deque[tuple[int, float, str]] = deque(maxlen=_MAX_FRAMES)

    @property
    def last_start_s(self) -> float | None:
        """Latest possible start of the last frame, by its stamp and earlier ones; None at first."""
        return self._last_start_s

    def add(self, stamped_start_s: float) -> None:
        """Add the time stamp of the next frame, and check the accepted frames against it."""
        earlier_s, self._last_start_s = self._last_start_s, stamped_start_s
        if earlier_s is not None:
            self._last_start_s = max(stamped_start_s, earlier_s + self._shortest_s)
        self._received += 1
        for number, acknowledged_s, name in self._accepted:
            # Received frames are counted: the meaning of gaps in sequence numbers is unknown.
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
        self, not_before_s: float, start_known_to_s: float, max_frames: int
    ) -> float | None:
        """Predicted start of the first frame exposed after `not_before_s`, at the latest.

        None if no frame was received yet, if that frame is more than `max_frames` ahead, or if the
        uncertainty of a time stamp, `start_known_to_s`, leaves two frames possible.
        """
        if self._last_start_s is None:
            return None
        frames = max(1, math.ceil((not_before_s - self._last_start_s) / self._period_s))
        error_s = start_known_to_s + frames * self._period_s * _PERIOD_ERROR
        start_s = self._last_start_s + frames * self._period_s
        margin_s = start_s - not_before_s
        is_certain = error_s <= margin_s and (frames == 1 or margin_s <= self._period_s - error_s)
        if not is_certain or frames > min(max_frames, _MAX_FRAMES):
            return None
        return start_s + error_s
