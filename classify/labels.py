"""The rule for labels, the names of texture classes."""

import unicodedata

from .errors import InputError


def checked_label(label: str) -> str:
    """Return `label` if it can name a class in files, tables and results.

    Raises
    ------
    InputError
        For characters that do not print, such as line ends, and for "unknown" in any spelling:
        results use that word for a surface that matches no class.
    """
    if not label.isprintable():
        raise InputError(f"label {label!r}: use printable characters only")
    if unicodedata.normalize("NFKC", label).strip().casefold() == "unknown":
        raise InputError(
            f"label {label!r}: 'unknown' stands for a surface that matches no class; "
            "choose another label"
        )
    return label
