"""The time, with a microsecond counter that wraps soon after the start and can be held."""

import host
from utime import sleep_ms, ticks_add, ticks_diff, ticks_ms

held_us = None


def ticks_us():
    return host.ticks_us() if held_us is None else held_us
