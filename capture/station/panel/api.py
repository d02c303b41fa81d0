"""The HTTP API: everything that the pages show and do, for programs."""

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import chain, islice

from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, Response, StreamingResponse

from capture.station.domain.roles import Role
from capture.station.results.audit import newest_changes, override_part
from capture.station.results.database import ResultsUnavailable
from capture.station.results.history import ROWS_AT_A_TIME, HistoryEntry, Selection
from capture.station.results.history_table import counts_of, csv_pieces, record_of
from capture.station.run.triggers import Accepted, Refused, Trigger
from classify.base.errors import InputError

from .event_stream import subscribed
from .filters import FILTERS, selection_of
from .metrics import MEDIA_TYPE, metrics_text
from .part_pictures.judged_by import stored_set
from .render import JsonAnswer
from .routes import Call, PanelRoute
from .security import Denied
from .triggering import OtherPart

MOST_ROWS = 500
PARTS = 50
LONGEST_WAIT_S = 30.0
# Patience of `results_access` with a locked database.
CHANGE_PATIENCE_S = 5.0


def whole_number(call: Call, name: str, default: int, most: int) -> int:
    """Return a whole number of a query, from 1 to `most`."""
    text = call.query.get(name, str(default))
    if not (text.isascii() and text.isdecimal() and len(text) < 16 and 1 <= int(text) <= most):
        raise InputError(f"{name} = {text[:20]!r}: give a whole number from 1 to {most}")
    return int(text)


def entry_of(call: Call) -> HistoryEntry:
    """Return the part that the path names."""
    part_id = call.path["part_id"]
    entry = call.panel.results.store.part(part_id)
    if entry is None:
        raise Denied(404, f"part {part_id[:100]}: there is no result of it")
    return entry


def _state(call: Call) -> Response:
    return JsonAnswer(call.panel.live.snapshot().fields())


async def _trigger(call: Call) -> Response:
    """Pass a trigger on; it is refused if the client leaves before the part is begun."""
    is_gone = threading.Event()

    async def watch() -> None:
        while (await call.request.receive())["type"] != "http.disconnect":
            pass
        is_gone.set()

    watcher = asyncio.create_task(watch())
    try:
        return await run_in_threadpool(_triggered, call, is_gone.is_set)
    finally:
        watcher.cancel()


def _triggered(call: Call, is_gone: Callable[[], bool]) -> Response:
    part_id, recipe = call.text("part_id", "") or None, call.text("recipe", "") or None
    if recipe is not None:
        call.panel.folder.recipe_files(recipe)  # raises for an invalid name
    key = call.request.headers.get("idempotency-key")
    try:
        answer = call.panel.triggers.submit(
            key, Trigger("http", part_id, recipe, is_withdrawn=is_gone)
        )
    except OtherPart as error:
        raise Denied(422, str(error)) from error
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
def _changing(call: Call) -> Iterator[None]:
    """Hold `Panel.changing`; clicks on a locked database must not keep all threads of the panel."""
    if not call.panel.changing.acquire(timeout=CHANGE_PATIENCE_S):
        raise ResultsUnavailable("nothing was changed: another change waits for the database")
    try:
        yield
    finally:
        call.panel.changing.release()


def _acknowledge(call: Call) -> Response:
    part_id, live = call.path["part_id"], call.panel.live
    with _changing(call):
        rejected = {part.result.part_id: part for part in live.snapshot().rejected}
        if part_id not in rejected:
            raise Denied(404, f"part {part_id[:100]}: is not among the last rejected parts")
        if rejected[part_id].acknowledged_by is None:
            decision = rejected[part_id].result.verdict.decision
            call.panel.changes.record(call.someone, f"part {part_id}", decision, "acknowledged")
            live.acknowledge(part_id, call.name)
    return JsonAnswer({"part_id": part_id, "acknowledged": True})


def newest_parts(
    call: Call, selection: Selection, most: int
) -> tuple[list[HistoryEntry], int | None]:
    """Return selected parts, the newest first, and ``below`` of the next page, None on the last."""
    if "below" in call.query:
        selection = replace(selection, below_number=whole_number(call, "below", 1, 2**53))
    entries = list(call.panel.results.store.parts(selection, newest=most + 1))[::-1]
    return entries[:most], entries[most - 1].result.number if len(entries) > most else None


def _parts(call: Call) -> Response:
    most = whole_number(call, "limit", PARTS, MOST_ROWS)
    entries, below = newest_parts(call, selection_of(call.query), most)
    return JsonAnswer(
        {
            "station": call.panel.folder.config.name,
            "parts": [record_of(entry) for entry in entries],
            "next_below": below,
        }
    )


def _counts(call: Call) -> Response:
    # Both kinds of rigs: real and simulated parts are counted apart.
    selection = selection_of({"simulated": "true"} | dict(call.query))
    counters = call.panel.results.store.counters(selection)
    return JsonAnswer({"station": call.panel.folder.config.name, **counts_of(counters)})


def _parts_csv(call: Call) -> Response:
    entries = call.panel.results.store.parts(selection_of(call.query))
    # The first piece is read before the answer begins, so that a database that does not answer is
    # an error 503.
    first = list(islice(entries, 1))
    lines = csv_pieces(chain(first, entries))
    # Each piece goes through a thread: one for each line would cost more than the lines.
    pieces: Iterator[str] = iter(lambda: "".join(islice(lines, ROWS_AT_A_TIME)), "")
    name = f"{call.panel.folder.config.name}-parts.csv"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return StreamingResponse(pieces, media_type="text/csv; charset=utf-8", headers=headers)


async def _part(call: Call) -> Response:
    """Answer with a part as soon as it has a result, at most after the client's `wait_s`."""
    wait_s = _seconds(call.query.get("wait_s", "0"))
    part_id, loop = call.path["part_id"], asyncio.get_running_loop()
    with subscribed(call.panel.live) as (subscription, changed):
        assert subscription is not None  # their number has no limit here
        ends_s, is_due = loop.time() + wait_s, True
        while True:
            changed.clear()
            events, lost = subscription.take()
            is_over = subscription.is_closed or loop.time() >= ends_s
            # The database is not asked again for events of other parts.
            is_told = lost > 0 or any(event.fields.get("part_id") == part_id for event in events)
            if is_due or is_told or is_over:
                try:
                    return JsonAnswer(await run_in_threadpool(lambda: record_of(entry_of(call))))
                except Denied:
                    if is_over:
                        raise
            is_due = False
            with suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), max(ends_s - loop.time(), 0.0))


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds <= LONGEST_WAIT_S:
        raise InputError(f"wait_s = {text[:20]!r}: give 0 to {LONGEST_WAIT_S:g} seconds")
    return seconds


def _set_file(call: Call) -> Response:
    path = stored_set(call.panel.folder, entry_of(call))
    return FileResponse(path, media_type="image/tiff", filename=path.name)


def override(call: Call) -> HistoryEntry:
    """Override the verdict of the part in the path by a form or JSON; return the part."""
    panel = call.panel
    with _changing(call):
        entry = entry_of(call)
        decision = override_part(
            panel.results.store,
            panel.changes,
            call.someone,
            entry,
            decision=call.text("decision"),
            by=call.name,
            reason=call.text("reason"),
        )
    part_id = entry.result.part_id
    panel.live.announce(
        {"event": "override", "part_id": part_id, "decision": decision, "by": call.name}
    )
    return entry_of(call)


def _override(call: Call) -> Response:
    return JsonAnswer(record_of(override(call)))


def _audit(call: Call) -> Response:
    changes = newest_changes(
        call.panel.results.store, whole_number(call, "limit", PARTS, MOST_ROWS)
    )
    return JsonAnswer({"changes": [vars(change) for change in changes]})


def _metrics(call: Call) -> Response:
    return Response(metrics_text(call.panel.live.snapshot()), media_type=MEDIA_TYPE)


V1 = "/api/v1"
ROUTES = (
    PanelRoute("GET", f"{V1}/state", Role.OPERATOR, _state, "State, last result, devices, counts."),
    PanelRoute(
        "POST", f"{V1}/trigger", Role.OPERATOR, _trigger,
        "Trigger a part: 202 accepted, 200 accepted before with this Idempotency-Key, 409 refused, "
        "422 if the key was accepted for another part or recipe.",
        fields={
            "part_id": "identity of the part; without it the station makes one",
            "recipe": "name of the recipe that must judge the part; 409 if another one is loaded",
        },
    ),
    PanelRoute(
        "GET", f"{V1}/parts", Role.OPERATOR, _parts, "Parts, the newest first.",
        query=FILTERS | {
            "limit": f"number of parts, {PARTS} by default, at most {MOST_ROWS}",
            "below": "only parts with a lower number: next_below of the page before",
        },
    ),
    PanelRoute(
        "GET", f"{V1}/parts.csv", Role.OPERATOR, _parts_csv, "All selected parts as CSV.",
        query=FILTERS, answer="text/csv",
    ),
    PanelRoute(
        "GET", f"{V1}/counts", Role.OPERATOR, _counts,
        "Numbers of parts by verdict, those of a simulated rig apart.",
        query=FILTERS | {"simulated": "false: only production; only: only a simulated rig"},
    ),
    PanelRoute(
        "GET", f"{V1}/parts/{{part_id}}", Role.OPERATOR, _part, "One part.",
        query={"wait_s": f"seconds to wait for its result, at most {LONGEST_WAIT_S:g}"},
    ),
    PanelRoute(
        "GET", f"{V1}/parts/{{part_id}}/set", Role.OPERATOR, _set_file,
        "The captured set of a part, an OME-TIFF.", answer="image/tiff",
    ),
    PanelRoute(
        "POST", f"{V1}/parts/{{part_id}}/acknowledge", Role.OPERATOR, _acknowledge,
        "Record that somebody has seen one of the last rejected parts.",
    ),
    PanelRoute(
        "POST", f"{V1}/parts/{{part_id}}/override", Role.ENGINEER, _override,
        "Give a part another verdict; the station's own stays beside it.",
        fields={"decision": "PASS or FAIL", "reason": "reason of the override"},
    ),
    PanelRoute(
        "GET", f"{V1}/audit", Role.ENGINEER, _audit, "Who changed what, the newest first.",
        query={"limit": f"number of changes, {PARTS} by default, at most {MOST_ROWS}"},
    ),
    PanelRoute(
        "GET", f"{V1}/metrics", Role.OPERATOR, _metrics, "Figures of this run for Prometheus.",
        answer="text/plain",
    ),
)  # fmt: skip
