"""Which frame of a loopback device is which, by the stamps that its writer gave."""

from __future__ import annotations

__all__ = ["WrittenFrames"]

# Of a period; the writer's stamps are exact to a microsecond.
_TOLERANCE = 0.01


class WrittenFrames:
    """Numbers for frames whose driver counts none, one for each period.

    ``v4l2loopback`` stamps all that it holds anew whenever a program claims buffers, with the time
    of that. So frames from before the opening are not believed, nor is one that does not come whole
    periods after the one before.

    Parameters
    ----------
    opened_s
        When our own buffers had been claimed, on the monotonic clock.
    period_s
        Of the frames.
    """

    def __init__(self, opened_s: float, period_s: float) -> None:
        self._opened_s = opened_s
        self._period_s = period_s
        self._last: tuple[int, float] | None = None

    def number_of(self, stamp_s: float) -> int | None:
        """The number of the frame that ended at `stamp_s`; None if the stamp is not believed."""
        if stamp_s <= self._opened_s:
            return None
        if self._last is None:
            self._last = (0, stamp_s)
            return 0
        number, last_s = self._last
        periods = (stamp_s - last_s) / self._period_s
        whole = round(periods)
        if abs(periods - whole) > _TOLERANCE:
            return None
        self._last = (number + whole, stamp_s)
        return number + whole
