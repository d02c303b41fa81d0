"""What people may write in options, forms, plans and recipes: names, texts, labels, numbers."""

import re
from typing import Annotated

from pydantic import AfterValidator, ValidationInfo

from classify.base.errors import InputError
from classify.methods import checked_label

SET_SUFFIX = ".ome.tif"
"""End of the name of a captured set."""
_MAX_CHARACTERS = 4000  # a page of text; longer notes belong in a file of their own
NAME_PATTERN = "^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$"


def file_name(name: str) -> str:
    """Return a name that can be part of names of files; ValueError for another."""
    if not re.fullmatch(NAME_PATTERN, name):
        raise ValueError(
            f"{name!r} becomes part of names of files; use up to 100 letters, digits and _ . -, "
            "and begin with a letter or digit"
        )
    return name


def checked_text(name: str, text: str) -> str:
    """Return `text` if it can stand in the metadata of a set under `name`."""
    if not text.isprintable():
        raise InputError(f"{name} {text!r}: use printable characters only")
    if len(text) > _MAX_CHARACTERS:
        raise InputError(
            f"{name}: {len(text)} characters; up to {_MAX_CHARACTERS} are kept in a set"
        )
    return text


def usable_label(label: str) -> str:
    """Return a label that can name a class; ValueError for another."""
    try:
        return checked_label(label)
    except InputError as error:
        raise ValueError(str(error)) from error


def typed_number(text: str) -> float:
    """Return a number of ASCII digits; `float` also takes ``1_000`` and digits of other scripts."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a number")
    return float(text)


def _usable_text(text: str, context: ValidationInfo) -> str:
    # A set with a text that is not printable could not be read again.
    try:
        return checked_text(context.field_name or "text", text)
    except InputError as error:
        raise ValueError(str(error)) from error


Name = Annotated[str, AfterValidator(file_name)]
Text = Annotated[str, AfterValidator(_usable_text)]
Label = Annotated[str, AfterValidator(usable_label)]
