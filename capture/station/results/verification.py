"""Compare the results of a station with its set files."""

from collections.abc import Iterator
from pathlib import Path

from sqlalchemy import func, select

from capture.base.names import SET_SUFFIX
from capture.session.verification import FileFinding
from capture.sets.ome_tiff import read_header
from capture.station.domain.config import CONFIG
from capture.station.domain.folder import PARTS, StationFolder
from classify.base.errors import InputError, Ps4rigError

from .chain import broken_links, has_link
from .history import HistoryEntry
from .schema import begun_parts
from .store import ResultStore, open_store


def verify_station(folder: Path, head: str | None = None) -> Iterator[FileFinding]:
    """Compare the results of a station with the hashes and names of its set files.

    `head` is a hash that was kept elsewhere, and must be in the chain of hashes.
    """
    # Findings about the results themselves are listed under ``station.toml``.
    try:
        station = StationFolder(folder)
        with open_store(station.results, station.config.name, exclusive=False) as store:
            yield from _findings(folder, store, head)
    except (Ps4rigError, ValueError) as error:  # ValueError: a cell that is not JSON
        yield FileFinding(folder / CONFIG, "altered", f"its results cannot be read: {error}")


def _findings(folder: Path, store: ResultStore, head: str | None) -> Iterator[FileFinding]:
    faults = [f"results: {fault}; restore a backup" for fault in _contradictions(store)]
    if head is not None:
        with store.reading() as connection:
            if not has_link(connection, store.station, head):
                faults.append(f"results: the chain of hashes has no link {head[:64]}")
    if unfinished := store.unfinished():
        first = unfinished[0].part_id
        faults.append(
            f"parts without a result: {len(unfinished)}, the first {first}; the station runs, or "
            "its next start ends them"
        )
    for fault in faults:
        yield FileFinding(folder / CONFIG, "altered", fault)
    if not faults:
        yield FileFinding(folder / CONFIG, "good")
    recorded_paths = set()
    for entry in store.parts():
        if entry.result.set_file is not None:
            path = folder / entry.result.set_file
            recorded_paths.add(path)
            yield from _set_findings(path, entry)
    for path in sorted((folder / PARTS).glob(f"*/*{SET_SUFFIX}")):
        if path not in recorded_paths:
            yield FileFinding(path, "not in results", "no result of the station names it")


def _set_findings(path: Path, entry: HistoryEntry) -> Iterator[FileFinding]:
    if not path.is_file():
        if entry.set_removed_utc is None:
            yield FileFinding(
                path, "missing", f"it is in the results, {entry.result.verdict.decision}"
            )
        return
    try:
        metadata, _ = read_header(path)
    except InputError:
        return  # `verify_file` reports a file that cannot be read
    if metadata.pixels_sha256 != entry.result.set_sha256:
        yield FileFinding(path, "altered", "its pixels are not those that the results name")


def _contradictions(store: ResultStore) -> Iterator[str]:
    """Yield a line for each contradiction: missing numbers or links, a damaged SQLite file."""
    yield from broken_links(store.reading, store.station)
    statement = select(func.count(), func.coalesce(func.max(begun_parts.c.number), 0)).where(
        begun_parts.c.station == store.station
    )
    with store.reading() as connection:
        count, last = connection.execute(statement).one()
        if count != last:
            yield f"{last - count} of {last} numbers of parts are missing"
        if connection.dialect.name == "sqlite":
            for (answer,) in connection.exec_driver_sql("PRAGMA integrity_check"):
                if answer != "ok":
                    yield answer
            for table, row, referenced, _ in connection.exec_driver_sql("PRAGMA foreign_key_check"):
                yield f"row {row} of {table} refers to a row of {referenced} that is missing"
