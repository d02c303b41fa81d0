"""Subscriptions for coroutines, which must not wait in a thread."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from capture.station.run.live_view import LiveView
from capture.station.run.subscription import Subscription

# Events within this time are one message: the end of an exposure, readiness, the next trigger.
# A verdict may be 200 ms late.
GATHER_MS = 10
_VERDICT = "part"


@contextmanager
def subscribed(
    live: LiveView, most: int | None = None
) -> Iterator[tuple[Subscription | None, asyncio.Event]]:
    """Yield a subscription, None beyond `most`, and the event set when it has something."""
    changed, loop = asyncio.Event(), asyncio.get_running_loop()

    def wake() -> None:
        with suppress(RuntimeError):  # the loop is closed at the end
            loop.call_soon_threadsafe(changed.set)

    subscription = live.subscribe(wake, most)
    try:
        yield subscription, changed
    finally:
        if subscription is not None:
            live.unsubscribe(subscription)


async def gather(subscription: Subscription, changed: asyncio.Event, gather_s: float) -> None:
    """Wait for events after the first one; a verdict waits no longer than `GATHER_MS`."""
    loop = asyncio.get_running_loop()
    ends_s = loop.time() + gather_s
    await asyncio.sleep(min(gather_s, 1e-3 * GATHER_MS))
    while not (subscription.is_closed or subscription.holds(_VERDICT)) and loop.time() < ends_s:
        changed.clear()
        with suppress(TimeoutError):
            await asyncio.wait_for(changed.wait(), ends_s - loop.time())
