"""Give a part another verdict: one way for pages, API clients and commands."""

from capture.base.utc_time import utc_text
from capture.station.domain.roles import Identity
from capture.station.domain.verdict import Decision
from capture.station.results.history import HistoryEntry
from capture.station.results.store import ResultStore
from classify.base.errors import InputError

from .audit import ChangeLog


def override_part(
    store: ResultStore,
    log: ChangeLog,
    who: Identity,
    entry: HistoryEntry,
    *,
    decision: str,
    by: str,
    reason: str,
) -> Decision:
    """Give a part another verdict beside the station's own.

    The same override again, as by a second click on a button, changes nothing.
    """
    part_id, given = entry.result.part_id, decision.upper()
    if given not in (Decision.PASS, Decision.FAIL):
        raise InputError(f"decision = {decision[:20]!r}: a person decides PASS or FAIL")
    if not reason.strip():
        raise InputError("reason: must not be empty")
    last = entry.override
    if last is not None and (last.decision, last.by, last.reason) == (given, by, reason.strip()):
        return last.decision
    log.record(who, f"part {part_id}", entry.decision, f"{given}: {reason.strip()}")
    utc = utc_text(timespec="milliseconds")
    store.override(part_id, decision=Decision(given), by=by, reason=reason, utc=utc)
    return Decision(given)
