"""A part of the history as a flat record, for CSV and JSON."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from typing import Any, TextIO

from capture.base.outputs import csv_line

from .chain import Head
from .history import Counters, HistoryEntry
from .part_result import COLUMNS as RESULT_COLUMNS

_FIRST_COLUMNS = (
    "station", "number", "part_id", "triggered_utc", "verdict", "reason", "causes", "simulated",
    "override", "set_removed_utc", "station_verdict",
)  # fmt: skip
_RENAMED_COLUMN = "decision"  # to verdict and station_verdict
COLUMNS = (
    *_FIRST_COLUMNS,
    *(name for name in RESULT_COLUMNS if name not in (*_FIRST_COLUMNS, _RENAMED_COLUMN)),
)


def record_of(entry: HistoryEntry) -> dict[str, Any]:
    """Return the columns of a part's result, with its override and removed set.

    ``verdict`` is the one in force, after overrides; ``station_verdict`` is the station's own.
    """
    row = entry.result.row
    record = {
        **row,
        "verdict": entry.decision.value,
        "station_verdict": row["decision"],
        "override": None if entry.override is None else asdict(entry.override),
        "set_removed_utc": entry.set_removed_utc,
    }
    return {name: record[name] for name in COLUMNS}


def write_csv(entries: Iterable[HistoryEntry], file: TextIO) -> None:
    """Write a line for each part (RFC 4180); lists and objects are JSON in their cell."""
    file.writelines(csv_pieces(entries))


def csv_pieces(entries: Iterable[HistoryEntry]) -> Iterator[str]:
    """Yield the lines of `write_csv`, so that they are never all in memory."""
    yield csv_line(COLUMNS)
    for entry in entries:
        yield csv_line(map(_cell, record_of(entry).values()))


def json_pieces(
    station: str, counters: Counters, chain: Head, entries: Iterable[HistoryEntry]
) -> Iterator[str]:
    """Yield the JSON of a history in pieces, so that it is never in memory as a whole."""
    head = {"station": station, **counts_of(counters), **vars(chain)}
    yield json.dumps(head)[:-1] + ', "parts": ['
    for position, entry in enumerate(entries):
        yield (",\n" if position else "\n") + json.dumps(record_of(entry), allow_nan=False)
    yield "\n]}\n"


def counts_of(counters: Counters) -> dict[str, Any]:
    """Return numbers of parts for JSON; those of a simulated rig apart."""
    return {name: vars(tally) for name, tally in vars(counters).items()}


def _cell(value: Any) -> Any:
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict) else value
