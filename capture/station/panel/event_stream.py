"""Events of the station as server-sent events, which a browser can resume."""

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response, StreamingResponse

from capture.station.domain.users import Role
from capture.station.run.live_view import LiveEvent, LiveView, Subscription
from capture.station.run.station_state import StationState

from .answers import media
from .guard import V1, ByOperator, identity_of
from .security import Denied

# Proxies and browsers give up silent connections after 30 s and more.
KEEP_ALIVE_S = 15.0
_RETRY_MS = 1000
router = APIRouter(prefix=V1)
_MEDIA_TYPE = "text/event-stream"
# Limit for one account or client, which leaves streams for others; `MAX_STREAMS` is that for all.
MAX_STREAMS_OF_ONE_CLIENT = 32
# Pause before a new stream ends the oldest one. Without it, clients that reconnect at once would
# end each other's streams in a fast loop.
TAKEOVER_PAUSE_S = 2.0


@contextmanager
def subscribed(
    live: LiveView, own_streams: list[Subscription] | None = None
) -> Iterator[tuple[Subscription, asyncio.Event]]:
    """Yield a subscription, and an asyncio event that is set when the subscription has events.

    Beyond `MAX_STREAMS_OF_ONE_CLIENT`, the oldest of `own_streams` ends.
    """
    changed, loop = asyncio.Event(), asyncio.get_running_loop()

    def wake() -> None:
        with suppress(RuntimeError):  # the loop is closed at the end
            loop.call_soon_threadsafe(changed.set)

    subscription = live.subscribe(wake)
    own_streams = [] if own_streams is None else own_streams
    own_streams.append(subscription)
    if len(own_streams) > MAX_STREAMS_OF_ONE_CLIENT:
        own_streams.pop(0).close()
    try:
        yield subscription, changed
    finally:
        live.unsubscribe(subscription)
        with suppress(ValueError):  # it was ended for a newer one
            own_streams.remove(subscription)


async def _place(call: ByOperator) -> AsyncIterator[None]:
    """Hold a place among the event streams until the answer ends."""
    with call.panel.event_streams.slot():
        yield


@router.get("/events", **media(_MEDIA_TYPE))
async def _events(
    call: ByOperator,
    _: Annotated[None, Depends(_place)],
    after: Annotated[
        str, Query(description="id of the last event that the client has, like Last-Event-ID")
    ] = "",
    last_event_id: Annotated[str | None, Header(description="in place of `after`")] = None,
) -> Response:
    """Everything that happens, as server-sent events; first the state, or what was missed."""
    last, live = after if last_event_id is None else last_event_id, call.panel.live

    async def is_still_allowed() -> bool:
        """Whether the user still exists, and the session goes on."""
        try:
            who = await run_in_threadpool(identity_of, call.panel, call.request)
        except Denied:
            return False
        return who is not None and who.role.includes(Role.OPERATOR)

    own_streams = call.panel.streams[call.someone.via, call.name]
    stream = _messages(live, last, is_still_allowed, own_streams)
    # A proxy must not buffer the events.
    headers = {"X-Accel-Buffering": "no"}
    return StreamingResponse(stream, media_type=_MEDIA_TYPE, headers=headers)


async def _messages(
    live: LiveView,
    last: str,
    is_still_allowed: Callable[[], Awaitable[bool]],
    own_streams: list[Subscription],
) -> AsyncIterator[str]:
    if len(own_streams) >= MAX_STREAMS_OF_ONE_CLIENT:
        await asyncio.sleep(TAKEOVER_PAUSE_S)
    # Subscribe here, when the stream is read: an answer that is never read would keep it forever.
    with subscribed(live, own_streams) as (subscription, changed):
        yield f"retry: {_RETRY_MS}\n\n"
        texts, sent = _missed(live, last)
        for text in texts:
            yield text
        is_closed, loop = False, asyncio.get_running_loop()
        due_s, check = loop.time() + KEEP_ALIVE_S, None
        while not is_closed:
            with suppress(TimeoutError):
                async with asyncio.timeout_at(due_s):
                    await changed.wait()
            if loop.time() >= due_s:  # also if events never pause
                yield ": still here\n\n"
                due_s = loop.time() + KEEP_ALIVE_S
                if check is None:
                    # Not awaited, because events would have to wait until it gets a thread.
                    check = asyncio.ensure_future(is_still_allowed())
                    check.add_done_callback(lambda _: changed.set())
            changed.clear()
            if check is not None and check.done():
                if not check.result():
                    return
                check = None
            is_closed = subscription.is_closed  # before the last events are taken
            waiting, lost_count = subscription.take()
            texts = []
            if lost_count:
                snapshot = live.snapshot()
                texts.append(_snapshot_message(snapshot))
                sent = snapshot.event_id
            texts += [_message(live.state.run, event) for event in waiting if event.id > sent]
            if texts:
                yield "".join(texts)


def _missed(live: LiveView, last: str) -> tuple[list[str], int]:
    """Messages that a client has missed, or else a snapshot, and the id of the last of them."""
    run, _, number = last.partition(".")
    if run == live.state.run and number.isdecimal() and len(number) < 16:
        after = live.events_after(int(number))
        if after is not None:
            return [_message(run, event) for event in after], int(number) + len(after)
    snapshot = live.snapshot()
    return [_snapshot_message(snapshot)], snapshot.event_id


def _message(run: str, event: LiveEvent) -> str:
    return _text(run, event.id, event.fields["event"], event.as_json)


def _snapshot_message(snapshot: StationState) -> str:
    data = json.dumps({"event": "snapshot", **snapshot.fields()}, allow_nan=False)
    return _text(snapshot.run, snapshot.event_id, "snapshot", data)


def _text(run: str, event_id: int, kind: str, data: str) -> str:
    """A message; `data` is one line, because JSON escapes line ends."""
    return f"id: {run}.{event_id}\nevent: {kind}\ndata: {data}\n\n"
