"""Exact confidence bounds of shares from counts, and tolerance limits."""

import math

from scipy.special import betaincinv, nctdtrit, ndtri

from .base.errors import InputError

CONFIDENCE = 0.95
"""Confidence of one-sided bounds, as usual in studies of gauges."""


def share_at_most(events: int, trials: int) -> float:
    """Return the exact upper bound of a share (Clopper and Pearson 1934); 1 without trials.

    >>> round(share_at_most(0, 149), 3)
    0.02
    """
    _check(events, trials)
    return 1.0 if events == trials else float(betaincinv(events + 1, trials - events, CONFIDENCE))


def share_at_least(events: int, trials: int) -> float:
    """Return the exact lower bound of a share; 0 without trials. See `share_at_most`."""
    return 1.0 - share_at_most(trials - events, trials)


def trials_to_show(share: float) -> int:
    """Return how many trials without an event show that its share is at most `share`.

    >>> trials_to_show(0.02)
    149
    """
    if not 0.0 < share < 1.0:
        raise InputError(f"a share of {share}: give one between 0 and 1")
    return math.ceil(math.log(1.0 - CONFIDENCE) / math.log(1.0 - share))


def tolerance_factor(count: int, coverage: float = 0.99) -> float:
    """Return k of the one-sided tolerance limit mean + k sigma of `count` values (Owen 1968).

    >>> [round(tolerance_factor(count), 2) for count in (3, 10, 30)]
    [10.55, 3.98, 3.06]
    """
    if count < 2:
        raise InputError(f"{count} values have no spread; give two or more")
    root = math.sqrt(count)
    return float(nctdtrit(count - 1, ndtri(coverage) * root, CONFIDENCE) / root)


def _check(events: int, trials: int) -> None:
    if not 0 <= events <= trials:
        raise InputError(f"{events} events in {trials} trials: give a count from 0 to the trials")
