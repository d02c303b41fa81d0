"""Times in files and logs: ISO 8601 in UTC, with a Z at the end."""

from datetime import UTC, datetime
from typing import Literal


def utc_text(
    moment: datetime | None = None, *, timespec: Literal["seconds", "milliseconds"] = "seconds"
) -> str:
    """Return a moment, by default now, as in ``2026-05-04T13:05:59Z``.

    Parameters
    ----------
    moment
        A time with its zone.
    timespec
        Smallest unit; what is finer is cut off.
    """
    return (
        (moment or datetime.now(UTC))
        .astimezone(UTC)
        .isoformat(timespec=timespec)
        .replace("+00:00", "Z")
    )
