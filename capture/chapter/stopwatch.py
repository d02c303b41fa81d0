"""Timing of functions that are compared with each other."""

import time
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

Work: TypeAlias = Callable[[], Any]
Clock: TypeAlias = Callable[[], float]


def shortest_ms(
    functions: Mapping[str, Work], rounds: int, clock_s: Clock = time.perf_counter
) -> dict[str, float]:
    """Duration of the shortest of `rounds` calls of each function, in milliseconds.

    Each round calls every function once, so that a busy machine slows all of them. The shortest
    call counts, because other processes only add time. A first call of each, which compiles and
    fills caches, is not timed.
    """
    for function in functions.values():
        function()
    shortest = dict.fromkeys(functions, float("inf"))
    for _ in range(rounds):
        for name, function in functions.items():
            shortest[name] = min(shortest[name], time_ms(function, clock_s))
    return shortest


def time_ms(function: Work, clock_s: Clock = time.perf_counter) -> float:
    """Duration of one call in milliseconds."""
    started_s = clock_s()
    function()
    return 1e3 * (clock_s() - started_s)
