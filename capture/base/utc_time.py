"""Times: in UTC as ISO 8601 for files and logs, and in the zone of this machine for people."""

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


def local_time(text: str, timespec: Literal["minutes", "seconds"] = "minutes") -> str:
    """Return a time of `utc_text` on this machine's clock: ``2026-05-04 15:05 CEST``."""
    moment = datetime.fromisoformat(text).astimezone()
    return f"{moment.replace(tzinfo=None).isoformat(' ', timespec)} {moment:%Z}"


def local_zone() -> str:
    """Return the zone of this machine's clock at present: ``CEST, UTC+02:00``."""
    moment = datetime.now().astimezone()
    return f"{moment:%Z}, UTC{moment.isoformat()[-6:]}"


def readable_utc(text: str) -> str:
    """Return a time of `utc_text` to the minute, for people: ``2026-05-04 13:05 UTC``."""
    return f"{text[:10]} {text[11:16]} UTC"
