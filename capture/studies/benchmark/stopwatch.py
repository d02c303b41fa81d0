"""Times that compare: every function in turn, round after round, the shortest of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

__all__ = ["Work", "least_ms", "once_ms"]

Work: TypeAlias = Callable[[], Any]


def least_ms(functions: Mapping[str, Work], rounds: int) -> dict[str, float]:
    """The shortest of `rounds` calls of each, milliseconds.

    Taken in turn, so that what disturbs the machine disturbs all of them; the shortest, because
    every disturbance only adds. A first call of each, which compiles and fills caches, is not
    counted.
    """
    for function in functions.values():
        function()
    least = dict.fromkeys(functions, float("inf"))
    for _ in range(rounds):
        for name, function in functions.items():
            least[name] = min(least[name], once_ms(function))
    return least


def once_ms(function: Work) -> float:
    """How long one call takes, milliseconds."""
    started_s = time.perf_counter()
    function()
    return 1e3 * (time.perf_counter() - started_s)
