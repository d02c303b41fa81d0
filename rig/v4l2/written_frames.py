"""Sequence numbers for the frames of a loopback device, from its writer's time stamps."""

# In periods. The writer's stamps are exact to a microsecond, the reported period to 1e-9 s: over
# 500 periods at 1 kHz, see test_written_frames.py, that adds up to 0.002.
_TOLERANCE = 0.01


class WrittenFrames:
    """Numbers frames by their time stamps, for a driver that does not count them.

    ``v4l2loopback`` replaces the stamps of all its frames by the current time whenever a program
    claims buffers. So a frame has no number if its stamp is not later than `opened_s`, the
    monotonic time at which this program claimed its buffers, or not a whole number of periods
    after that of the last numbered frame.
    """

    def __init__(self, opened_s: float, period_s: float) -> None:
        self._opened_s = opened_s
        self._period_s = period_s
        self._last: tuple[int, float] | None = None

    def number_of(self, stamp_s: float) -> int | None:
        """The number of the frame stamped `stamp_s`; None if the stamp is not the writer's."""
        if stamp_s <= self._opened_s:
            return None
        if self._last is None:
            self._last = (0, stamp_s)
            return 0
        number, last_s = self._last
        periods = (stamp_s - last_s) / self._period_s
        steps = round(periods)
        if abs(periods - steps) > _TOLERANCE:
            return None
        self._last = (number + steps, stamp_s)
        return number + steps
