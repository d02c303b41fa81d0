"""`ChangeLog`: every change that a person or a program makes, before it is made."""

from capture.station.domain.folder import StationFolder
from capture.station.domain.roles import Identity
from capture.station.results.change_log import record_change
from capture.station.results.database import ResultsUnavailable
from capture.station.results.results_access import ResultsAccess


class ChangeLog:
    """Writes changes to the database of results, made if missing, and to ``station.log``.

    A change is recorded before it is made, so that none is without a row.
    """

    def __init__(self, folder: StationFolder, results: ResultsAccess) -> None:
        self._folder, self._results = folder, results

    def record(
        self, who: Identity, what: str, before: str | None = None, after: str | None = None
    ) -> None:
        """Record a change, which must not be made if this raises `ResultsUnavailable`."""
        try:
            record_change(self._results.made(), what, before, after, by=who.name, role=who.role)
        except ResultsUnavailable as error:
            raise ResultsUnavailable(
                f"nothing was changed, because the change cannot be recorded: {error}",
                may_pass=error.may_pass,
            ) from error
        said = "nothing" if before is None else before
        line = f"{who.name} ({who.role}, {who.via}): {what}: {said} -> {after or 'nothing'}"
        # One line, whatever somebody gave as a reason.
        self._folder.log("change by " + "".join(c if c.isprintable() else " " for c in line))
