"""Times of results: UTC as text of one fixed form, so that texts sort as times do."""

import re
from datetime import UTC, date, datetime, timedelta

from classify.errors import InputError

_FORM = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z")


def utc_text(moment: datetime) -> str:
    """Return a time as ``2026-11-22T17:08:13.042Z``; `moment` must know its time zone."""
    if moment.tzinfo is None:
        raise ValueError(f"{moment}: without a time zone")
    return moment.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def is_utc_text(text: str) -> bool:
    """Whether a text has the form that `utc_text` writes."""
    return _FORM.fullmatch(text) is not None


def utc_bound(option: str, text: str, *, is_end: bool = False) -> str:
    """Return the time that a person gave as a bound, in the form of `utc_text`.

    Parameters
    ----------
    option
        Name of the option, for the message.
    text
        ISO 8601: a date, or a date with a time. Without an offset it is UTC.
    is_end
        Whether a date alone stands for its last millisecond, instead of its first.

    Raises
    ------
    InputError
        If it is neither.
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
        return utc_text(moment)
    except (ValueError, OverflowError) as error:
        raise InputError(
            f"{option} {text or repr(text)}: give a date or a time (UTC), such as 2026-11-22 or "
            "2026-11-22T14:30"
        ) from error
