"""The error of a part in the words of its record."""


def stated_error(share: float, decimals: int) -> str:
    """Return an error in percent; one that rounds to 0 is given as the smallest that does not."""
    return f"{max(share, 0.01 * 10.0**-decimals):.{decimals}%}"
