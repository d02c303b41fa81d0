"""Errors of the inspection station, and the text of any error."""

from classify.base.errors import InputError, Ps4rigError

# Characters that are kept of an exception's text, which may be a whole document.
_MAX_CHARACTERS = 500


class NotFound(InputError):  # noqa: N818 - the state of a station, no error of the program
    """A user, client or part that a request names does not exist."""


class Conflict(InputError):  # noqa: N818 - the state of a station, no error of the program
    """A request conflicts with the state of the station."""


class RecipeError(Conflict):
    """A recipe, or a file that teaching made, cannot be used; the message says what to do."""


class NotApproved(RecipeError):  # noqa: N818 - the state of a recipe, no error of the program
    """A recipe that nobody approved as it is."""


class ChallengeFailed(Ps4rigError):  # noqa: N818 - a verdict on a recipe, no error of the program
    """A part of the challenge set gets another verdict than it must; the message names it."""

    exit_status = 1


class CannotListen(InputError):  # noqa: N818 - the state of the machine, no error of the program
    """A port is taken, or the network does not have its address yet: a later start may succeed."""

    exit_status = 3


def error_text(error: BaseException) -> str:
    """Return the text of an error as one line; unknown kinds of errors are named."""
    if isinstance(error, MemoryError):
        return "not enough memory"
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    try:
        text = " ".join(str(error).split())[:_MAX_CHARACTERS]
    except Exception:  # its __str__ failed
        text = ""
    is_known = isinstance(error, Ps4rigError | OSError)
    return text if text and is_known else f"{type(error).__name__}: {text}".rstrip(": ")
