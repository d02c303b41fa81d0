"""`Awaiting`: subscriptions for coroutines, which must not wait in a thread."""

import asyncio
from collections.abc import Callable, Coroutine, Hashable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

from capture.station.run.live_station import LiveStation
from capture.station.run.subscription import Subscription

# Events within this time are one message: the end of an exposure, readiness, the next trigger.
# A verdict may be 200 ms late.
GATHER_MS = 10
_VERDICT = "part"


class Awaiting:
    """Subscriptions of the coroutines of one event loop.

    One call of the loop wakes all of them: each call costs the station's thread a system call.
    """

    def __init__(self, live: LiveStation) -> None:
        self._live = live
        self._all: set[asyncio.Event] = set()
        self._is_due = False

    @contextmanager
    def subscribed(
        self, most: int | None = None
    ) -> Iterator[tuple[Subscription | None, asyncio.Event]]:
        """Yield a subscription, None beyond `most`, and the event set when it has something."""
        changed = asyncio.Event()
        wake = partial(self._wake, asyncio.get_running_loop())
        subscription = self._live.subscribe(wake, most)
        self._all.add(changed)
        try:
            yield subscription, changed
        finally:
            self._all.discard(changed)
            if subscription is not None:
                self._live.unsubscribe(subscription)

    def _wake(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._is_due:
            return
        self._is_due = True
        with suppress(RuntimeError):  # the loop is closed at the end of the run
            loop.call_soon_threadsafe(self._set_all)

    def _set_all(self) -> None:
        self._is_due = False  # reset first, so that later events wake again
        for event in self._all:
            event.set()


async def gather(subscription: Subscription, changed: asyncio.Event, gather_s: float) -> None:
    """Wait for events after the first one; a verdict waits no longer than `GATHER_MS`."""
    loop = asyncio.get_running_loop()
    ends_s = loop.time() + gather_s
    await asyncio.sleep(min(gather_s, 1e-3 * GATHER_MS))
    while not (subscription.is_closed or subscription.holds(_VERDICT)) and loop.time() < ends_s:
        changed.clear()
        with suppress(TimeoutError):
            await asyncio.wait_for(changed.wait(), ends_s - loop.time())


class SharedAnswers:
    """Answers in the making. All pages show the last part, and ask for its pictures at once."""

    def __init__(self) -> None:
        self._made: dict[Hashable, asyncio.Task[bytes]] = {}

    async def answer(self, key: Hashable, make: Callable[[], Coroutine[Any, Any, bytes]]) -> bytes:
        """Return what `make` returns, or raise what it raises, for all who ask meanwhile.

        It goes on if a client leaves: others may wait for it.
        """
        task = self._made.get(key)
        if task is None:
            task = self._made[key] = asyncio.create_task(make())
            task.add_done_callback(lambda done: self._forget(key, done))
        return await asyncio.shield(task)

    def _forget(self, key: Hashable, done: asyncio.Task[bytes]) -> None:
        del self._made[key]
        if not done.cancelled():
            done.exception()  # retrieved here, because all clients may have left
