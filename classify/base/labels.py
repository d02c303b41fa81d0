"""The rule for labels, the names of texture classes."""

import unicodedata

from .errors import InputError


def checked_label(label: str) -> str:
    """Return `label` if it prints and is not "unknown", the word for a surface of no class."""
    if not label.isprintable():
        raise InputError(f"label {label!r}: use printable characters only")
    if unicodedata.normalize("NFKC", label).strip().casefold() == "unknown":
        raise InputError(
            f"label {label!r}: 'unknown' stands for a surface that matches no class; "
            "choose another label"
        )
    return label
