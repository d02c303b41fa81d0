"""Identities of parts: given by the trigger, or made from the number of the part."""

import re

from classify.errors import InputError

# They are names of files too, on every system, so neither a leading dot nor a blank.
_GIVEN = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_MADE = re.compile(r"part-\d+", re.IGNORECASE)


def made_part_id(number: int) -> str:
    """Return the identity of a part whose trigger gave none."""
    return f"part-{number:06d}"


def require_given_part_id(part_id: str) -> str:
    """Return an identity that came with a trigger.

    Raises
    ------
    InputError
        If it cannot name a file, or could be one that the station makes.
    """
    if not _GIVEN.fullmatch(part_id):
        raise InputError(
            f"part id {part_id[:100]!r}: give 1 to 100 letters, digits, dots, dashes or "
            "underscores, the first a letter or a digit"
        )
    if _MADE.fullmatch(part_id):
        raise InputError(
            f"part id {part_id}: the station makes ids of this form itself; give another one"
        )
    return part_id
