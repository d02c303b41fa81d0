"""``sets.csv``: one row for each planned set of a session."""

import csv
import io
from collections.abc import Collection, Mapping, Sequence

from capture.sets.description import plain

from .journal import SetEntry
from .plan import SessionPlan

_Cell = str | float | None
COLUMNS = (
    "specimen", "label", "orientation_deg", "repeat", "planned", "state", "file", "captured_utc",
    "exposure_ms", "operator", "note", "calibration", "estimated_deg", "saturated_share",
    "shadowed_share", "blur_px", "warnings", "error", "corrected", "pixels_sha256",
)  # fmt: skip


def sets_table(
    plan: SessionPlan,
    entries: Sequence[SetEntry],
    present: Collection[tuple[str, float, int]],
    damaged: Mapping[str, str],
) -> str:
    """Return the table as CSV (RFC 4180): planned sets, then those no longer planned.

    `present` has the keys of the entries whose file is there, `damaged` the errors of files.
    """
    planned = {entry.key: entry for entry in map(SetEntry.of, plan.sets())}
    entered = {entry.key: entry for entry in entries}
    labels = {specimen.id: specimen.label or specimen.id for specimen in plan.specimen}
    rows = []
    for key, entry in {**planned, **entered}.items():
        error = damaged.get(entry.file or "")
        state = "missing"
        if entry.skipped is not None:
            state = "left out"
        elif key in present:
            state = "captured" if error is None else "damaged"
        row = _row(entry) | {"planned": plain(key in planned), "state": state, "error": error}
        if entry.description is None:
            row["label"] = labels.get(entry.specimen)
        rows.append(row)
    descriptions = [entry.description for entry in entries if entry.description is not None]
    properties = sorted(
        {_column(name) for description in descriptions for name in description.properties}
    )
    lights = max((len(entry.measures.led_levels) for entry in entries if entry.measures), default=0)
    text = io.StringIO()
    writer = csv.DictWriter(text, [*COLUMNS, *map(_level, range(lights)), *properties])
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _row(entry: SetEntry) -> dict[str, _Cell]:
    row: dict[str, _Cell] = {
        "specimen": entry.piece,
        "orientation_deg": plain(entry.entered_deg),
        "repeat": entry.repeat,
        "file": entry.file,
        "captured_utc": entry.captured_utc,
        "pixels_sha256": entry.pixels_sha256,
        "warnings": entry.skipped,
    }
    description, measures = entry.description, entry.measures
    if description is not None:
        row |= {
            "label": description.label,
            "exposure_ms": plain(description.exposure_ms),
            "operator": description.operator,
            "note": description.note,
            "calibration": " ".join(description.calibration_ids),
            "corrected": " ".join(description.corrected),
        }
        row |= {_column(name): plain(value) for name, value in description.properties.items()}
    if measures is not None:
        row |= {
            "estimated_deg": _rounded(measures.estimated_deg, 2),
            "saturated_share": _rounded(measures.saturated, 6),
            "shadowed_share": _rounded(measures.shadowed, 6),
            "blur_px": _rounded(measures.blur_px, 2),
            "warnings": "; ".join(measures.warnings),
        }
        row |= {_level(k): _rounded(value, 6) for k, value in enumerate(measures.led_levels)}
    return row


def _level(light: int) -> str:
    return f"level_led_{light}"


def _column(name: str) -> str:
    """Column of a property: its name, unless a column of every table is called so."""
    small = name.casefold()
    is_reserved = small in COLUMNS or small.startswith(("level_led_", "property_"))
    return f"property_{name}" if is_reserved else name


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
