"""Errors of the inspection station."""

from classify.errors import InputError


class RecipeError(InputError):
    """A recipe, or what was taught for it, that cannot be used; the message says what to do."""
