"""Sources of triggers, with a station that does what a test says."""

import pytest

from capture.station.run.triggers import Refused, TimerTrigger, Trigger


class Clock:
    """Goes on by a little whenever it is read."""

    def __init__(self) -> None:
        self.s = 0.0

    def now_s(self) -> float:
        self.s += 0.01
        return self.s


class SlowStation:
    """Answers its first trigger late, such as while its database is locked."""

    def __init__(self, clock: Clock, late_s: float, count: int = 3) -> None:
        self._clock, self._late_s, self._count = clock, late_s, count
        self.submitted_s: list[float] = []
        self.refused: list[str] = []

    @property
    def is_stopping(self) -> bool:
        return len(self.submitted_s) == self._count

    def wait_until_ready(self, timeout_s: float) -> bool:
        return timeout_s > 0.0

    def submit(self, _: Trigger) -> Refused:
        self.submitted_s.append(self._clock.s)
        if len(self.submitted_s) == 1:
            self._clock.s += self._late_s
        return Refused("busy")

    def refuse(self, _: Trigger, refused: Refused) -> Refused:
        self.refused.append(refused.reason)
        return refused


@pytest.mark.parametrize(("late_s", "periods", "counted"), [(0.05, [0, 1, 2], []),
                                                          (0.35, [0, 4, 5], [3])])  # fmt: skip
def test_the_timer_keeps_its_period_after_a_late_answer(
    late_s: float, periods: list[int], counted: list[int]
) -> None:
    clock = Clock()
    station = SlowStation(clock, late_s)
    TimerTrigger(0.1, clock.now_s).run(station)  # type: ignore[arg-type]
    began_s = station.submitted_s[0]
    # The part of a period that has passed is not below the camera any more.
    found = [(each - began_s) / 0.1 for each in station.submitted_s]
    assert found == pytest.approx(periods, abs=0.3)
    assert station.refused == [f"late: {n} periods of the timer have passed" for n in counted]


def test_periods_that_passed_before_a_stop_are_refused() -> None:
    clock = Clock()
    station = SlowStation(clock, 0.35, count=1)
    TimerTrigger(0.1, clock.now_s).run(station)  # type: ignore[arg-type]
    assert station.refused == ["late: 3 periods of the timer have passed"]


def test_a_timer_whose_refusals_take_longer_than_its_period_still_triggers() -> None:
    clock = Clock()

    class SlowRecords(SlowStation):
        @property
        def is_stopping(self) -> bool:
            return super().is_stopping or len(self.refused) == 50

        def refuse(self, trigger: Trigger, refused: Refused) -> Refused:
            self.counted_until_s = clock.s
            clock.s += 0.25
            return super().refuse(trigger, refused)

    station = SlowRecords(clock, 0.35)
    TimerTrigger(0.1, clock.now_s).run(station)  # type: ignore[arg-type]
    assert len(station.submitted_s) == 3
    # Each period has its trigger, or counts in a row.
    periods = int((station.counted_until_s - station.submitted_s[0]) / 0.1)
    counted = [int(reason.split()[1]) for reason in station.refused]
    assert sum(counted) + len(station.submitted_s) - 1 == periods
