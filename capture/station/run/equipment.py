"""`Equipment` and threads of a station's cycle."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from capture.station.results.store import ResultStore
from rig.doctor.check import Check

from .live_station import LiveStation
from .outcome import PartJudge
from .run_recipes import RunRecipes
from .station_clock import StationClock
from .station_rig import StationRig
from .triggers import PartSensor

Worker = Literal["capture", "verdict"]
"""A thread of the cycle."""
ReportAlive = Callable[[Worker], None]
"""Called by each worker several times a second, unless it hangs."""


class GuardedThread(threading.Thread):
    """A thread that stops the run at its end, with the error that ended it or None."""

    def __init__(
        self,
        work: Callable[[], None],
        stop: Callable[[BaseException | None], None],
        name: str,
        *,
        daemon: bool = False,
    ) -> None:
        super().__init__(name=name, daemon=daemon)
        self._work, self._stop_run_with = work, stop

    def run(self) -> None:
        """Do the work."""
        error: BaseException | None = None
        try:
            self._work()
        except BaseException as raised:
            error = raised
        self._stop_run_with(error)

    def join_through_interrupts(self, timeout_s: float | None = None) -> None:
        """Wait for the end of the thread, if it was started; Ctrl-C stops the run."""
        while self.is_alive():
            try:
                self.join(timeout_s)
                return
            except KeyboardInterrupt as interrupt:
                self._stop_run_with(interrupt)


@dataclass(frozen=True, eq=False)
class Equipment:
    """Rig, judge, results, clock and interfaces of a cycle."""

    rig: StationRig
    judge: PartJudge  # used until another recipe is loaded
    store: ResultStore
    # Makes all checks except those of the rig; called while no part is in progress.
    prepare: Callable[[], list[Check]]
    clock: StationClock
    live: LiveStation
    sensor: PartSensor | None = None
    report_alive: ReportAlive = lambda _: None
    recipes: RunRecipes | None = None  # None if no parts are judged
