"""Times of results: UTC with milliseconds as text, so that texts sort as times do."""

import re
from datetime import UTC, date, datetime, timedelta

from capture.base.utc_time import utc_text
from classify.base.errors import InputError

_FORM = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z")
_MINUTE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d")


def require_utc(text: str) -> str:
    """Return a time of the form ``2026-11-22T17:08:13.042Z``; `ValueError` for another one."""
    if not _FORM.fullmatch(text):
        raise ValueError(f"{text!r}: not a time such as 2026-11-22T17:08:13.042Z")
    return text


def utc_bound(option: str, text: str, *, is_end: bool = False) -> str:
    """Return the time of a bound that a person gave in ISO 8601, UTC without an offset.

    `is_end` takes the last millisecond of a date, or of a time in minutes, instead of the first.
    """
    try:
        if len(text) == len("2026-11-22"):
            day = date.fromisoformat(text)
            moment = datetime(day.year, day.month, day.day, tzinfo=UTC)
            if is_end:
                moment += timedelta(days=1, milliseconds=-1)
        else:
            moment = datetime.fromisoformat(text)
            moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
            if is_end and _MINUTE.fullmatch(text):
                moment += timedelta(minutes=1, milliseconds=-1)
        return utc_text(moment, timespec="milliseconds")
    except (ValueError, OverflowError) as error:
        raise InputError(
            f"{option} {text or repr(text)}: give a date or a time (UTC), such as 2026-11-22 or "
            "2026-11-22T14:30"
        ) from error
