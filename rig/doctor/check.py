"""One thing that was looked at: what was seen, and what to do about it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from classify.errors import Ps4rigError

__all__ = ["Check", "Status", "answered"]

Status = Literal["ok", "warning", "fault", "unknown"]


@dataclass(frozen=True)
class Check:
    """A finding of the doctor.

    Attributes
    ----------
    name
        What was looked at.
    status
        ``warning`` is what works but should not stay, ``fault`` what keeps sets from being good,
        ``unknown`` what could not be looked at.
    seen
        What was found, with numbers.
    advice
        What to do; empty if nothing.
    """

    name: str
    status: Status
    seen: str
    advice: str = ""


def answered(name: str, look: Callable[[], Iterator[Check]]) -> list[Check]:
    """The checks of `look`, with a fault called `name` in place of what it raises."""
    checks: list[Check] = []
    try:
        checks.extend(look())
    except (Ps4rigError, OSError) as error:
        checks.append(Check(name, "fault", str(error)))
    return checks
