"""The root of the one exception tree; `rig` and `capture` hang their branches on it."""

__all__ = ["InputError", "LibraryError", "Ps4rigError"]


class Ps4rigError(Exception):
    """What a user is told in one line. `exit_status` is what the command line returns for it."""

    exit_status = 2


class InputError(Ps4rigError):
    """An image, a file or an option is not usable; the message names it and the way out."""


class LibraryError(InputError):
    """A texture library that cannot be read, or does not fit the surface it is asked about."""
