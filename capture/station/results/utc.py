"""Times of results: UTC with milliseconds as text, so that texts sort as times do."""

import re
from datetime import UTC, date, datetime, timedelta

from capture.base.utc_time import utc_text
from classify.base.errors import InputError

_FORM = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z")
_MINUTE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d")
_DAY_LENGTH = len("2026-11-22")


def require_utc(text: str) -> str:
    """Return a time of the form ``2026-11-22T17:08:13.042Z``; `ValueError` for another one."""
    if not _FORM.fullmatch(text):
        raise ValueError(f"{text!r}: not a time such as 2026-11-22T17:08:13.042Z")
    return text


def utc_bound(option: str, text: str, *, is_end: bool = False, is_local: bool = False) -> str:
    """Return the time of a bound in ISO 8601, by default UTC without an offset."""
    # `is_end` takes the last millisecond of a date, or of a time in minutes, instead of the first,
    # and the later one of two equal times on the day on which the clock is set back.
    try:
        if len(text) == _DAY_LENGTH:
            text = f"{date.fromisoformat(text)}T{'23:59' if is_end else '00:00'}"
        moment = datetime.fromisoformat(text)
        if moment.tzinfo is None:
            zone = None if is_local else UTC
            moment = moment.replace(tzinfo=zone, fold=int(is_end)).astimezone(UTC)
        if is_end and _MINUTE.fullmatch(text):
            moment += timedelta(minutes=1, milliseconds=-1)
        return utc_text(moment, timespec="milliseconds")
    except (ValueError, OverflowError) as error:
        raise InputError(
            f"{option} {text or repr(text)}: give a date or a time, such as 2026-11-22 or "
            "2026-11-22T14:30"
        ) from error
