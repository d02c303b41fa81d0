"""Errors of the inspection station, and any error in one line."""

from classify.errors import InputError, Ps4rigError

# Of the text of an exception, which may carry a whole document.
_MOST_SAID = 500


class RecipeError(InputError):
    """A recipe, or what was taught for it, that cannot be used; the message says what to do."""


class ChallengeFailed(Ps4rigError):  # noqa: N818 - a verdict on a recipe, no error of the program
    """A part of the challenge set gets another verdict than it must; the message names it."""

    exit_status = 1


def said(error: BaseException) -> str:
    """Return what an error says, in one line."""
    if isinstance(error, MemoryError):
        return "not enough memory"
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    try:
        text = " ".join(str(error).split())[:_MOST_SAID]
    except Exception:  # of an error whose text cannot be made
        text = ""
    is_known = isinstance(error, Ps4rigError | OSError)
    return text if text and is_known else f"{type(error).__name__}: {text}".rstrip(": ")
