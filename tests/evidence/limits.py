"""Rows of a study: a figure beside its limit."""


def at_most(name: str, value: float, limit: float) -> bool:
    """Print a figure and its limit; return whether it is met."""
    return _row(name, value, "most", limit, value <= limit)


def at_least(name: str, value: float, limit: float) -> bool:
    """Print a figure and its limit; return whether it is met."""
    return _row(name, value, "least", limit, value >= limit)


def _row(name: str, value: float, which: str, limit: float, is_met: bool) -> bool:
    print(
        f"{name:44} {value:9.4g}   at {which} {limit:g}{'' if is_met else '   MISSED'}", flush=True
    )
    return is_met
