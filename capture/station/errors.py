"""Errors of the inspection station."""

from classify.errors import InputError, Ps4rigError


class RecipeError(InputError):
    """A recipe, or what was taught for it, that cannot be used; the message says what to do."""


class ChallengeFailed(Ps4rigError):  # noqa: N818 - a verdict on a recipe, no error of the program
    """A part of the challenge set gets another verdict than it must; the message names it."""

    exit_status = 1
