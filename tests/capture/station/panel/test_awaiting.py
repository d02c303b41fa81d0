"""Coroutines that wait for events of a station."""

import asyncio
import threading

from capture.station.panel.event_stream import subscribed
from capture.station.run.live_station import LiveStation
from capture.station.run.live_view import MOST_WAITING

READERS = 5
EVENTS = MOST_WAITING - 1  # none is lost, however late a reader is
LONGEST_S = 30.0


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
