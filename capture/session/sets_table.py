"""``sets.csv``: one row for each planned set of a session."""

import csv
import io
from collections.abc import Iterator

from .journal import Journal, SetEntry
from .plan import SessionPlan

COLUMNS = (
    "specimen", "label", "orientation_deg", "repeat", "state", "file", "captured_utc",
    "estimated_deg", "saturated", "shadowed", "blur_px", "led_levels", "warnings", "pixels_sha256",
    "corrections",
)  # fmt: skip


def sets_table(plan: SessionPlan, journal: Journal) -> str:
    """Return the table as CSV (RFC 4180): planned sets, then those no longer planned."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    labels = {each.id: each.label or each.id for each in plan.specimen}
    for entry in _entries(plan, journal):
        writer.writerow(_row(entry, labels.get(entry.specimen)))
    return text.getvalue()


def _entries(plan: SessionPlan, journal: Journal) -> Iterator[SetEntry]:
    planned_keys = set()
    for planned in plan.sets():
        entry = journal.entry_of(planned) or SetEntry.of(planned)
        planned_keys.add(entry.key)
        yield entry
    yield from (entry for entry in journal.entries if entry.key not in planned_keys)


def _row(entry: SetEntry, label: str | None) -> list[object]:
    state = "captured" if entry.file else "left out" if entry.skipped else "missing"
    said = entry.description
    row: list[object] = [
        entry.piece, label if said is None else said.label, _exact(entry.entered_deg),
        entry.repeat, state, entry.file, entry.captured_utc,
    ]  # fmt: skip
    corrections = "" if said is None else "; ".join(said.corrected)
    if entry.measures is None:
        unknown = [None] * 5
        return [*row, *unknown, entry.skipped, entry.pixels_sha256, corrections]
    measures = entry.measures
    return [
        *row,
        _rounded(measures.estimated_deg, 2),
        _rounded(measures.saturated, 5),
        _rounded(measures.shadowed, 4),
        _rounded(measures.blur_px, 2),
        " ".join(f"{level:.4f}" for level in measures.led_levels),
        "; ".join(measures.warnings),
        entry.pixels_sha256,
        corrections,
    ]


def _exact(value: float | None) -> str | None:
    return None if value is None else repr(value).removesuffix(".0")


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
