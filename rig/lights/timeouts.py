"""Time-outs of the driver of a light controller."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LinkTimeouts:
    """Time-outs in seconds of real time, except `unused_s`, which is on the rig's clock.

    Attributes
    ----------
    open_s
        For the first answer after a port is opened. An Arduino that resets when its port is
        opened answers after about two seconds.
    reply_s
        For the reply to one command. The firmware answers within milliseconds. A write may
        take 20 times as long.
    recover_s
        For a controller that was plugged in again; Linux needs a second or two for its port.
    unused_s
        A program that has not used the lights for this long has forgotten them or hangs, and its
        keep-alive ends.
    """

    open_s: float = 3.0
    reply_s: float = 0.5
    recover_s: float = 5.0
    unused_s: float = 600.0


DEFAULT_TIMEOUTS = LinkTimeouts()
