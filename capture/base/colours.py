"""Colours of the curves of a figure."""

_COLOURS = ("#2166ac", "#b2182b", "#1b7837", "#762a83", "#e08214", "#01665e", "#555555", "#c51b7d")


def curve_colour(number: int) -> str:
    """Return the colour of a curve, numbered from 0; they repeat after eight."""
    return _COLOURS[number % len(_COLOURS)]
