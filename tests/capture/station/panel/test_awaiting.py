"""Coroutines that wait for events of a station."""

import asyncio
import threading
import time

from capture.station.panel.awaiting import GATHER_MS, gather, subscribed
from capture.station.run.live_station import LiveStation
from capture.station.run.subscription import MOST_WAITING, LiveEvent

READERS = 5
EVENTS = MOST_WAITING - 1  # none is lost, however late a reader is
LONGEST_S = 30.0


def event(kind: str) -> LiveEvent:
    return LiveEvent(1, "", {"event": kind})


def test_no_reader_misses_an_event_that_a_thread_announces() -> None:
    async def seen() -> list[list[int]]:
        live = LiveStation("line-1", simulated=True)

        async def read() -> list[int]:
            numbers: list[int] = []
            with subscribed(live) as (subscription, changed):
                assert subscription is not None
                reading.release()
                while len(numbers) < EVENTS:
                    await asyncio.wait_for(changed.wait(), LONGEST_S)
                    changed.clear()
                    events, lost = subscription.take()
                    assert not lost
                    numbers += [each.fields["number"] for each in events]
            return numbers

        def announce() -> None:
            for _ in range(READERS):
                assert reading.acquire(timeout=LONGEST_S)
            for number in range(EVENTS):
                live.announce({"event": "override", "number": number})

        reading = threading.Semaphore(0)
        announcing = threading.Thread(target=announce)
        announcing.start()
        found = await asyncio.gather(*(read() for _ in range(READERS)))
        announcing.join(LONGEST_S)
        assert live.snapshot().subscribers == 0
        return found

    assert asyncio.run(seen()) == [list(range(EVENTS))] * READERS


def test_events_are_gathered_until_a_verdict_comes() -> None:
    async def gathered() -> list[LiveEvent]:
        live, changed = LiveStation("line-1", simulated=True), asyncio.Event()
        subscription = live.subscribe(changed.set)
        assert subscription is not None
        subscription.put(event("state"))
        waiting = asyncio.create_task(gather(subscription, changed, 2.0 * LONGEST_S))
        await asyncio.sleep(4e-3 * GATHER_MS)
        assert not waiting.done()
        subscription.put(event("begun"))
        subscription.put(event("part"))
        await asyncio.wait_for(waiting, LONGEST_S)
        return subscription.take()[0]

    kinds = [each.fields["event"] for each in asyncio.run(gathered())]
    assert kinds == ["state", "begun", "part"]


def test_events_without_a_verdict_are_gathered_for_their_time() -> None:
    async def gathered() -> float:
        live, changed = LiveStation("line-1", simulated=True), asyncio.Event()
        subscription = live.subscribe(changed.set)
        assert subscription is not None
        subscription.put(event("state"))
        began_s = time.monotonic()
        await asyncio.wait_for(gather(subscription, changed, 0.05), LONGEST_S)
        return time.monotonic() - began_s

    assert asyncio.run(gathered()) >= 0.05
