"""Time-outs of the driver of a light controller."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LinkTimeouts:
    """Time-outs in seconds of real time, except `unused_s`, which is on the rig's clock."""

    open_s: float = 3.0  # first answer; an Arduino that resets when opened takes 2 s
    reply_s: float = 0.5  # the firmware takes milliseconds; a write may take 20 times as long
    recover_s: float = 5.0  # Linux needs a second or two for the port of a board plugged in again
    unused_s: float = 600.0  # a program silent for this long hangs: its keep-alive ends


DEFAULT_TIMEOUTS = LinkTimeouts()
