"""Part ids: given with the trigger, or made from the number of the part."""

import re

from sqlalchemy import Connection, select

from capture.base.outputs import escaped
from classify.base.errors import InputError

from .schema import begun_parts, lower_ascii

_MAX_LENGTH = 100
# They are also file names on every system: no leading dot, no blank.
_PART_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
# Devices of Windows, whatever follows their name.
_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_GENERATED_ID = re.compile(r"part-\d+", re.IGNORECASE)


def made_part_id(number: int) -> str:
    """Return the id of a part whose trigger gave none."""
    return f"part-{number:06d}"


def bounded_part_id(text: str) -> str:
    """Return a text that is still no id if it is none, in little memory and without surrogates."""
    return text[: _MAX_LENGTH + 1].encode("utf-8", "backslashreplace").decode()


def shown_part_id(part_id: str) -> str:
    """Return an id that may be invalid for lines of text: its beginning, escaped."""
    return escaped(part_id[:_MAX_LENGTH])


def require_given_part_id(part_id: str) -> str:
    """Return the id of a trigger; it must name a file, and not look like an id of the station."""
    if not _PART_ID.fullmatch(part_id):
        raise InputError(
            f"part id {part_id[:_MAX_LENGTH]!r}: give 1 to 100 letters, digits, dots, dashes or "
            "underscores, the first a letter or a digit"
        )
    if _DEVICE.fullmatch(part_id):
        raise InputError(f"part id {part_id}: cannot be a file name on Windows; give another one")
    if _GENERATED_ID.fullmatch(part_id):
        raise InputError(
            f"part id {part_id}: the station makes ids of this form itself; give another one"
        )
    return part_id


def require_new_part_id(connection: Connection, station: str, part_id: str) -> None:
    """Check that a station has not had a part with this id, in upper or lower case."""
    known = connection.scalar(
        select(begun_parts.c.part_id)
        .where(begun_parts.c.station == station)
        .where(lower_ascii(begun_parts.c.part_id) == part_id.lower())
        .order_by(begun_parts.c.part_id != part_id)
    )
    if known == part_id:
        raise InputError(f"part {part_id}: this station has had a part with this id")
    if known is not None:
        raise InputError(
            f"part {part_id}: this station has had part {known}; ids that differ only in case "
            "would name the same file on some systems"
        )
