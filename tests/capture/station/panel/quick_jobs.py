"""Jobs for tests: they count, wait or fail."""

import time
from typing import Any, NoReturn

from capture.base.console import ShowProgress
from classify.base.errors import InputError


def count(show: ShowProgress, most: int) -> dict[str, Any]:
    """Count, and say so."""
    return {"counted": list(show(range(most), most, "count"))}


def wait(show: ShowProgress) -> NoReturn:
    """Never end."""
    for _ in show(iter(int, 1), 1, "wait"):
        time.sleep(0.01)
    raise AssertionError


def fail(show: ShowProgress, is_known: bool) -> NoReturn:  # noqa: ARG001
    """Raise an error of this program, or another one."""
    raise InputError("there is no such part") if is_known else ValueError("a defect")
