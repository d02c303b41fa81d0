"""Differences of angles."""


def off_deg(found: float, true: float, period_deg: float = 180.0) -> float:
    """Absolute difference of two angles that are equal modulo `period_deg`."""
    half = period_deg / 2.0
    return abs((found - true + half) % period_deg - half)
