"""Subscriptions for coroutines, which must not wait in a thread."""

import asyncio
from contextlib import suppress

from capture.station.live.live_station import LiveStation
from capture.station.live.subscription import Subscription


def awaited(
    live: LiveStation, most: int | None = None
) -> tuple[Subscription | None, asyncio.Event]:
    """Return a subscription, and the event that is set when it has something to take.

    The subscription is None if there are `most` already.
    """
    loop, changed = asyncio.get_running_loop(), asyncio.Event()

    def wake() -> None:
        with suppress(RuntimeError):  # the loop is closed at the end of the run
            loop.call_soon_threadsafe(changed.set)

    return live.subscribe(wake, most), changed
