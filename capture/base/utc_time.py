"""Times in UTC: ISO 8601 for files and logs, and a form for sentences."""

from datetime import UTC, datetime
from typing import Literal


def utc_text(
    moment: datetime | None = None, *, timespec: Literal["seconds", "milliseconds"] = "seconds"
) -> str:
    """Return a moment with its zone, by default now, as in ``2026-05-04T13:05:59Z``."""
    return (
        (moment or datetime.now(UTC))
        .astimezone(UTC)
        .isoformat(timespec=timespec)
        .replace("+00:00", "Z")
    )


def readable_utc(text: str) -> str:
    """Return a time of `utc_text` to the minute, for people: ``2026-05-04 13:05 UTC``."""
    return f"{text[:10]} {text[11:16]} UTC"
