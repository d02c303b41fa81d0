"""The log of changes that people and programs make, each recorded before it is made."""

import os
import threading
import unicodedata
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass

from sqlalchemy import select

from capture.base.utc_time import utc_text
from capture.station.domain.folder import StationFolder
from capture.station.domain.own_folder import user_name
from capture.station.domain.users import Identity, Role
from capture.station.domain.verdict import Decision
from classify.base.errors import InputError

from .database import ResultsUnavailable
from .history import HistoryEntry
from .schema import changes
from .store import AppendRemotely, ResultStore, open_store

CHANGE_TIMEOUT_S = 5.0
"""Time for which a page waits for a locked database."""
_MAX_NAME_LENGTH = 200  # as in the approval of a recipe
# Categories of Unicode: control, format (such as a change of direction), surrogates, separators.
_CONTROL = ("Cc", "Cf", "Cs", "Zl", "Zp")


@dataclass(frozen=True)
class ChangeRecord:
    """A change at a station."""

    utc: str
    by: str
    role: str
    via: str  # as in `Identity`, or ``PLC``
    what: str  # the changed thing, such as ``user kim``
    before: str | None = None
    after: str | None = None


def record_change(
    store: ResultStore,
    what: str,
    before: str | None = None,
    after: str | None = None,
    *,
    by: str,
    role: str,
    via: str,
) -> None:
    """Append a change to the log, with the present time; see `ChangeRecord`."""
    record = ChangeRecord(utc_text(timespec="milliseconds"), by, role, via, what, before, after)
    store.append(changes, vars(record))


def newest_changes(store: ResultStore, count: int) -> list[ChangeRecord]:
    """Return the last changes, the newest first."""
    columns = [changes.c[name] for name in ChangeRecord.__dataclass_fields__]
    statement = (
        select(*columns)
        .where(changes.c.station == store.station)
        .order_by(changes.c.position.desc())
        .limit(count)
    )
    with store.reading() as connection:
        return [ChangeRecord(**row._mapping) for row in connection.execute(statement)]


class ResultsAccess:
    """Opens the results on first use, when they may not exist, and records changes of people.

    A change has a row in the results, and a line in ``station.log``.
    """

    def __init__(
        self, folder: StationFolder, append_remotely: AppendRemotely = lambda *_: False
    ) -> None:
        self._folder, self._append_remotely = folder, append_remotely
        self._lock = threading.Lock()
        self._store: ResultStore | None = None

    @property
    def store(self) -> ResultStore:
        """The opened results; raises `ResultsUnavailable` if there is no database."""
        return self._opened(create=False)

    def opened_or_created(self) -> ResultStore:
        """Return the results; create a missing database if the station has no sets of parts.

        A new database numbers parts from 1, so that new sets would overwrite those.
        """
        return self._opened(create=not self._folder.has_sets())

    def _opened(self, *, create: bool) -> ResultStore:
        with self._lock:
            if self._store is None:
                try:
                    self._store = open_store(
                        self._folder.results,
                        self._folder.config.name,
                        create=create,
                        exclusive=False,
                        timeout_s=CHANGE_TIMEOUT_S,
                    )
                except InputError as error:
                    raise ResultsUnavailable(str(error)) from error
                self._store.append_remotely = self._append_remotely
            return self._store

    def close(self) -> None:
        """Close all connections."""
        with self._lock:
            if self._store is not None:
                self._store.close()
                self._store = None

    def record(
        self, who: Identity, what: str, before: str | None = None, after: str | None = None
    ) -> None:
        """Record a change, which must not be made if this raises `ResultsUnavailable`."""
        try:
            store = self.opened_or_created()
            record_change(store, what, before, after, by=who.name, role=who.role, via=who.via)
        except ResultsUnavailable as error:
            raise ResultsUnavailable(
                f"nothing was changed, because the change cannot be recorded: {error}",
                is_transient=error.is_transient,
            ) from error
        old = "nothing" if before is None else before
        self._log(
            f"change by {who.name} ({who.role}, {who.via}): {what}: {old} -> {after or 'nothing'}"
        )

    def record_failed_login(self, name: str, address: str, via: str, unrecorded: int) -> None:
        """Record a failed login, and the number of `unrecorded` ones since the last record."""
        what = f"login as {name[:_MAX_NAME_LENGTH]}"
        after = "failed" + (f"; {unrecorded} further failed logins before it" if unrecorded else "")
        store = self.opened_or_created()
        record_change(store, what, None, after, by=address, role="none", via=via)
        self._log(f"{what} from {address}: {after}")

    def override(
        self, who: Identity, entry: HistoryEntry, *, decision: str, by: str, reason: str
    ) -> Decision:
        """Give a part another verdict beside that of the station; an equal one changes nothing.

        The override is in the name of `by`. The log of changes names `who`, such as the user of the
        computer on whose terminal `by` decided.
        """
        part_id, verdict, reason = entry.result.part_id, decision.upper(), reason.strip()
        if verdict not in (Decision.PASS, Decision.FAIL):
            raise InputError(f"decision = {decision[:20]!r}: a person decides PASS or FAIL")
        if not reason:
            raise InputError("reason: must not be empty")
        if any(unicodedata.category(letter) in _CONTROL for letter in reason):
            raise InputError("reason: has control characters or line breaks; leave them out")
        last = entry.override
        if last is not None and (last.decision, last.by, last.reason) == (verdict, by, reason):
            return last.decision
        self.record(who, f"part {part_id}", entry.decision, f"{verdict}: {reason}")
        utc = utc_text(timespec="milliseconds")
        self.store.override(part_id, decision=Decision(verdict), by=by, reason=reason, utc=utc)
        return Decision(verdict)

    def _log(self, line: str) -> None:
        # One line for each change, although texts of people may have line breaks.
        self._folder.log("".join(c if c.isprintable() else " " for c in line))


@contextmanager
def changing_on_the_terminal(
    folder: StationFolder, by: str | None = None
) -> Iterator[tuple[ResultsAccess, Identity]]:
    """Yield the results, and the identity for their log: `by` and the user of the system."""
    if by is not None and not (by.strip() and by.isprintable() and len(by) <= _MAX_NAME_LENGTH):
        raise InputError(f"--by {by[:20]!r}: give 1 to {_MAX_NAME_LENGTH} printable characters")
    user = system_user()
    name = f"{user}, on the terminal" if by is None else f"{by}, on the terminal as {user}"
    with closing(ResultsAccess(folder)) as results:
        yield results, Identity(name, Role.ADMINISTRATOR, "command")


def system_user() -> str:
    """Return the user of this process, not that of environment variables such as LOGNAME."""
    return user_name(os.getuid()) if hasattr(os, "getuid") else os.getlogin()
