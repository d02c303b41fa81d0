"""The HTTP API: everything that the pages show and do, for programs."""

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import chain, islice
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Header, Query
from pydantic import Field, FiniteFloat, PlainValidator, WithJsonSchema, conlist
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, Response, StreamingResponse

from capture.base.names import NAME_PATTERN
from capture.station.domain.verdict import Cause, Decision
from capture.station.results.audit import (
    CHANGE_TIMEOUT_S,
    ChangeRecord,
    newest_changes,
)
from capture.station.results.database import ResultsUnavailable
from capture.station.results.history import (
    PAGE_ROWS,
    HistoryEntry,
    Override,
    Selection,
    Tally,
    counts_of,
    csv_pieces,
    record_of,
)
from capture.station.results.part_result import PartResult, bounded_part_id
from capture.station.run.events import Device
from capture.station.run.station_state import StationState
from capture.station.run.triggers import Accepted, Refused, Trigger
from classify.base.models import Record

from .answers import JsonAnswer, Name, answer, media
from .event_stream import subscribed
from .filters import Filters
from .guard import V1, ByEngineer, ByOperator, Call, Turn
from .judged_by import stored_set
from .panel import Panel
from .security import Denied
from .triggering import MAX_KEY_LENGTH

_MAX_ROWS = 500
PARTS = 50
"""Number of rows of an answer and of a page, by default."""
_MAX_WAIT_S = 30.0
router = APIRouter(prefix=V1)
Below = Annotated[
    int | None,
    Query(ge=1, le=2**53, description="only parts below this number: next_below of an answer"),
]
_Row = answer("Row", PartResult, "verdict", reason=str, causes=list[Cause])
_Judged = answer("Judged", _Row, decision=Decision)
_Last = answer("Last", _Judged, latency_ms=float | None)
_Rejected = answer("Rejected", _Judged, acknowledged_by=str | None)
_State = answer(
    "Snapshot",
    StationState,
    "tested",
    devices=tuple[Device, ...],
    last=_Last | None,
    rejected=conlist(_Rejected),
)
_Part = answer(
    "Part",
    _Row,
    verdict=Annotated[Decision, Field(description="that holds, after overrides")],
    station_verdict=Decision,
    override=Override | None,
    set_removed_utc=str | None,
)
_Parts = answer("Parts", station=str, parts=conlist(_Part), next_below=int | None)
Numbers = answer("Numbers", Tally)
_Counts = answer("Counts", station=str, production=Numbers, simulated=Numbers)
_Triggered = answer("Triggered", accepted=bool, part_id=str, number=int | None, repeated=bool)
_Acknowledged = answer("Acknowledged", part_id=str, acknowledged=bool)
_Stopped = answer("Stopped", reason=str, acknowledged=bool)
_Changes = answer("Changes", changes=list[ChangeRecord])
_PART_ID = {
    "type": "string",
    "description": "identity of the part; without it the station makes one",
    "pattern": f"^({NAME_PATTERN[1:-1]})?$",
}
_Limit = Annotated[int, Query(ge=1, le=_MAX_ROWS)]


class _PartsQuery(Filters):
    limit: int = Field(PARTS, ge=1, le=_MAX_ROWS, description="number of parts")
    below: Below = None


class _CountsQuery(Filters):
    simulated: Literal["", "true", "false", "only"] = Field(
        "true", description="false: only production; only: only a simulated rig"
    )


def _part_text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError("must be a text")
    return bounded_part_id(value)


class PartFields(Record):
    """A part to trigger."""

    # Not checked here: a trigger with an invalid id is recorded as refused.
    part_id: Annotated[str, PlainValidator(_part_text), WithJsonSchema(_PART_ID)] = ""
    recipe: Name | None = Field(
        None,
        description="name of the recipe that must judge the part; 409 if another one is loaded",
    )


# At least one letter, and no control characters.
_REASON = r"^[^\x00-\x1f\x7f-\x9f]*[^\x00-\x20\x7f-\xa0][^\x00-\x1f\x7f-\x9f]*$"
_ANY_PART = PartFields()


class OverrideFields(Record):
    """The verdict of a person."""

    decision: Literal["PASS", "FAIL"]
    reason: Annotated[str, Field(pattern=_REASON)]


def entry_of(panel: Panel, part_id: str) -> HistoryEntry:
    """Return a part."""
    entry = panel.results.store.part(part_id)
    if entry is None:
        raise Denied(404, f"part {part_id[:100]}: there is no result of it")
    return entry


@router.get("/state", response_model=_State)
def _state(call: ByOperator) -> Response:
    """State, last result, devices, counts."""
    return JsonAnswer(call.panel.live.snapshot().fields())


@router.post(
    "/trigger",
    status_code=202,
    response_model=_Triggered,
    responses={200: {"model": _Triggered, "description": "accepted before with this key"}},
)
async def _trigger(
    call: ByOperator,
    body: PartFields = _ANY_PART,
    idempotency_key: Annotated[
        str | None,
        Header(
            description="a repeated request with it triggers no second part",
            min_length=1,
            max_length=MAX_KEY_LENGTH,
        ),
    ] = None,
) -> Response:
    """Trigger a part: 202 accepted, 200 accepted before with this key, 409 refused.

    422 if the key was accepted for another part or recipe. A client that leaves early is refused.
    """
    is_gone = threading.Event()

    async def watch() -> None:
        while (await call.request.receive())["type"] != "http.disconnect":
            pass
        is_gone.set()

    watcher = asyncio.create_task(watch())
    try:
        return await run_in_threadpool(_submit, call, body, idempotency_key, is_gone.is_set)
    finally:
        watcher.cancel()


def _submit(call: Call, body: PartFields, key: str | None, is_gone: Callable[[], bool]) -> Response:
    trigger = Trigger("http", body.part_id or None, body.recipe, is_withdrawn=is_gone)
    answer = call.panel.triggers.submit(key, trigger)
    if isinstance(answer, Refused):
        return JsonAnswer({"accepted": False, "error": answer.reason}, 409)
    is_new = isinstance(answer, Accepted)
    return JsonAnswer(
        {
            "accepted": True,
            "part_id": answer.part_id,
            "number": answer.number,
            "repeated": not is_new,
        },
        202 if is_new else 200,
        {"Location": f"/api/v1/parts/{answer.part_id}"},
    )


@contextmanager
def _changing(panel: Panel) -> Iterator[None]:
    """Hold `Panel.changing`, or raise ResultsUnavailable."""
    # With the timeout, clicks while the database is locked leave threads for other requests.
    if not panel.changing.acquire(timeout=CHANGE_TIMEOUT_S):
        raise ResultsUnavailable("nothing was changed: another change waits for the database")
    try:
        yield
    finally:
        panel.changing.release()


@router.post("/parts/{part_id}/acknowledge", response_model=_Acknowledged)
def _acknowledge(call: ByOperator, part_id: str) -> dict[str, Any]:
    """Record that somebody has seen one of the last rejected parts."""
    live = call.panel.live
    with _changing(call.panel):
        rejected = {part.result.part_id: part for part in live.snapshot().rejected}
        if part_id not in rejected:
            raise Denied(404, f"part {part_id[:100]}: is not among the last rejected parts")
        if rejected[part_id].acknowledged_by is None:
            decision = rejected[part_id].result.verdict.decision
            call.panel.results.record(call.someone, f"part {part_id}", decision, "acknowledged")
            live.acknowledge(part_id, call.name)
    return {"part_id": part_id, "acknowledged": True}


@router.post("/acknowledge", response_model=_Stopped)
def _acknowledge_fault(call: ByOperator) -> dict[str, Any]:
    """Record that somebody has seen the errors in a row that stop the line: it goes on."""
    with _changing(call.panel):
        state = call.panel.live.snapshot()
        if not state.is_stopped_by_errors:
            raise Denied(409, "no errors in a row stop the line")
        call.panel.results.record(
            call.someone, f"station {state.station}", state.reason, "acknowledged"
        )
        call.panel.live.acknowledge(None, call.name)
    return {"reason": state.reason, "acknowledged": True}


def newest_parts(
    panel: Panel, selection: Selection, max_count: int, below: int | None
) -> tuple[list[HistoryEntry], int | None]:
    """Return selected parts, the newest first, and ``below`` of the next page."""
    selection = replace(selection, below_number=below)
    entries = list(panel.results.store.parts(selection, newest=max_count + 1))[::-1]
    page = entries[:max_count]
    is_last_page = len(entries) <= max_count
    return page, None if is_last_page else page[-1].result.number


@router.get("/parts", response_model=_Parts)
def _parts(call: ByOperator, filters: Annotated[_PartsQuery, Query()]) -> Response:
    """Parts, the newest first."""
    entries, next_below = newest_parts(call.panel, filters.selection, filters.limit, filters.below)
    return JsonAnswer(
        {
            "station": call.panel.folder.config.name,
            "parts": [record_of(entry) for entry in entries],
            "next_below": next_below,
        }
    )


@router.get("/counts", response_model=_Counts)
def _counts(call: ByOperator, filters: Annotated[_CountsQuery, Query()]) -> Response:
    """Numbers of parts by verdict, those of a simulated rig apart."""
    counters = call.panel.results.store.counters(filters.selection)
    return JsonAnswer({"station": call.panel.folder.config.name, **counts_of(counters)})


@router.get("/parts.csv", **media("text/csv"))
def _parts_csv(call: ByOperator, _: Turn, filters: Annotated[Filters, Query()]) -> Response:
    """All selected parts as CSV."""
    entries = call.panel.results.store.parts(filters.selection)
    # The first piece is read before the answer begins, so that a database that does not answer is
    # an error 503.
    first = list(islice(entries, 1))
    lines = csv_pieces(chain(first, entries))
    # Each piece goes through a thread: one for each line would cost more than the lines.
    pieces: Iterator[str] = iter(lambda: "".join(islice(lines, PAGE_ROWS)), "")
    name = f"{call.panel.folder.config.name}-parts.csv"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return StreamingResponse(pieces, media_type="text/csv", headers=headers)


@router.get("/parts/{part_id}", response_model=_Part)
async def _part(
    call: ByOperator,
    part_id: str,
    wait_s: Annotated[
        FiniteFloat, Query(ge=0.0, le=_MAX_WAIT_S, description="seconds to wait for its result")
    ] = 0.0,
) -> Response:
    """One part, as soon as it has a result."""

    def record() -> dict[str, Any]:
        return record_of(entry_of(call.panel, part_id))

    loop = asyncio.get_running_loop()
    with subscribed(call.panel.live) as (subscription, changed):
        deadline_s, must_read = loop.time() + wait_s, True
        while True:
            changed.clear()
            events, lost_count = subscription.take()
            is_over = subscription.is_closed or loop.time() >= deadline_s
            # Events of other parts need no further query of the database.
            has_event = lost_count > 0 or any(
                event.fields.get("part_id") == part_id for event in events
            )
            if must_read or has_event or is_over:
                try:
                    return JsonAnswer(await run_in_threadpool(record))
                except Denied:
                    if is_over:
                        raise
            must_read = False
            with suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), max(deadline_s - loop.time(), 0.0))


@router.get("/parts/{part_id}/set", **media("image/tiff"))
def _captured_set(call: ByOperator, part_id: str) -> Response:
    """The captured set of a part, an OME-TIFF."""
    path = stored_set(call.panel.folder, entry_of(call.panel, part_id))
    return FileResponse(path, media_type="image/tiff", filename=path.name)


def override(call: Call, part_id: str, decision: str, reason: str) -> HistoryEntry:
    """Give a part another verdict; return the part."""
    panel = call.panel
    with _changing(panel):
        entry = entry_of(panel, part_id)
        decided = panel.results.override(
            call.someone, entry, decision=decision, by=call.name, reason=reason
        )
    panel.live.announce(
        {"event": "override", "part_id": part_id, "decision": decided, "by": call.name}
    )
    return entry_of(panel, part_id)


@router.post("/parts/{part_id}/override", response_model=_Part)
def _override(call: ByEngineer, part_id: str, body: OverrideFields) -> Response:
    """Give a part another verdict; the station's own stays beside it."""
    return JsonAnswer(record_of(override(call, part_id, body.decision, body.reason)))


@router.get("/audit", response_model=_Changes)
def _audit(call: ByEngineer, limit: _Limit = PARTS) -> dict[str, Any]:
    """Who changed what, the newest first."""
    return {"changes": newest_changes(call.panel.results.store, limit)}
