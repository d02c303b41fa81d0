"""Two numbers as texts with enough digits to tell them apart."""

import math

# A 64-bit float has 17 digits.
_MOST_DIGITS = 17


def told_apart(value: float, bound: float, form: str) -> tuple[str, str]:
    """Return two numbers as texts, with more digits than `form` (``.2f``) until they differ."""
    digits, kind = int(form[1:-1]), form[-1]
    if math.isfinite(value) and value != bound:
        while digits < _MOST_DIGITS and f"{value:.{digits}{kind}}" == f"{bound:.{digits}{kind}}":
            digits += 1
    return f"{value:.{digits}{kind}}", f"{bound:.{digits}{kind}}"
