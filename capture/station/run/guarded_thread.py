"""`GuardedThread`: a thread whose end ends the run of a station."""

import threading
from collections.abc import Callable


class GuardedThread(threading.Thread):
    """A thread that calls `stop` at its end, with the error that ended it or None."""

    def __init__(
        self,
        work: Callable[[], None],
        stop: Callable[[BaseException | None], None],
        name: str,
        *,
        daemon: bool = False,
    ) -> None:
        super().__init__(name=name, daemon=daemon)
        self._work, self._stop_run = work, stop

    def run(self) -> None:
        """Do the work."""
        error: BaseException | None = None
        try:
            self._work()
        except BaseException as raised:
            error = raised
        self._stop_run(error)

    def join_through_interrupts(self) -> None:
        """Wait for the end of the thread, if it was started."""
        while self.is_alive():
            try:
                self.join()
            except KeyboardInterrupt as interrupt:
                self._stop_run(interrupt)
