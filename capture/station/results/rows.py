"""Rows of the table ``results`` from `PartResult`, and back."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from capture.station.domain.verdict import Cause, Decision, Verdict

from .part_result import MEASURES, DefectRecord, PartResult

# Characters of a text; an exception may carry a whole document, and each part has a row.
MAX_TEXT = 2000


def storable(text: str) -> str:
    """Return text that every database holds: surrogates and NUL escaped, at most `MAX_TEXT`."""
    escaped = text.encode("utf-8", "backslashreplace").decode("utf-8").replace("\0", "\\x00")
    return escaped if len(escaped) <= MAX_TEXT else f"{escaped[: MAX_TEXT - 1]}…"


def row_of(result: PartResult) -> dict[str, Any]:
    """Return the values of the columns for a result."""
    row = dict(vars(result))
    del row["verdict"]
    row |= {name: None if row[name] is None else float(row[name]) for name in MEASURES}
    row |= {
        "decision": result.verdict.decision.value,
        "reason": result.verdict.reason,
        "causes": [cause.value for cause in result.verdict.causes],
        "defects": [asdict(defect) for defect in result.defects],
        "led_levels": [float(level) for level in result.led_levels],
        "timings_ms": {name: float(ms) for name, ms in result.timings_ms.items()},
        "notes": [storable(note) for note in result.notes],
    }
    return {
        name: storable(value) if isinstance(value, str) else value for name, value in row.items()
    }


def result_of(row: Mapping[str, Any]) -> PartResult:
    """Return the result of a row of the table ``results``."""
    values = dict(row)
    verdict = Verdict(
        Decision(values.pop("decision")),
        values.pop("reason"),
        tuple(map(Cause, values.pop("causes"))),
    )
    values["defects"] = tuple(DefectRecord(**defect) for defect in values["defects"])
    values |= {name: tuple(values[name]) for name in ("led_levels", "notes")}
    return PartResult(verdict=verdict, **values)
