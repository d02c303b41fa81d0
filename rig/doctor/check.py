"""The result of one check: finding and advice."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from classify.base.errors import Ps4rigError

Status = Literal["ok", "warning", "fault", "unknown"]


@dataclass(frozen=True)
class Check:
    """The result of one check; a ``warning`` still allows good sets, a ``fault`` does not."""

    name: str
    status: Status
    seen: str  # the finding, with its values
    advice: str = ""
    device: str = ""  # that it tests, such as ``lights``; empty for none


def run_checks(name: str, checks: Callable[[], Iterator[Check]], device: str = "") -> list[Check]:
    """Run some checks; an error that they raise becomes a fault called `name`."""
    results: list[Check] = []
    try:
        results.extend(checks())
    except (Ps4rigError, OSError) as error:
        results.append(Check(name, "fault", str(error), device=getattr(error, "device", device)))
    return results
