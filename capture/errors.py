"""The answer "no": a set that must not be used."""

from classify.errors import Ps4rigError

__all__ = ["SetRejected"]


class SetRejected(Ps4rigError):  # noqa: N818 - not a fault of the program but a verdict on a set
    """A captured set failed its checks; the message names every cause. Nothing is kept of it."""

    exit_status = 1
