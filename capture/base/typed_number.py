"""Numbers that people type in options and forms."""


def typed_number(text: str) -> float:
    """Return a number of ASCII digits; `float` also takes ``1_000`` and digits of other scripts."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a number")
    return float(text)
