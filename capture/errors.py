"""The error of a set that failed its checks."""

from classify.errors import Ps4rigError


class SetRejected(Ps4rigError):  # noqa: N818 - a verdict on a set, not an error of the program
    """A set failed its checks and is not written; the message names every cause."""

    exit_status = 1
