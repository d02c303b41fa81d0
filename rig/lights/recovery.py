"""Finding the same light controller again after its line has failed."""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from rig.errors import LightControllerError

from .link import ControllerIdentity, ControllerLink, LinkTimeouts

Whereabouts = Callable[[], Iterable[str]]
"""The ports on which a controller may be now, the most likely one first."""

_PAUSE_S = 0.1  # between two rounds through the ports; short against the second that USB takes


def find_again(
    lost: ControllerIdentity, whereabouts: Whereabouts, baud: int, timeouts: LinkTimeouts
) -> ControllerLink:
    """Open the line to the controller with the same serial number, on any of the ports."""
    deadline_s = time.monotonic() + timeouts.recover_s
    while True:
        failure: LightControllerError | None = None
        for port in whereabouts():
            left_s = max(0.1, deadline_s - time.monotonic())
            try:
                link = ControllerLink(port, baud, replace(timeouts, open_s=left_s))
            except LightControllerError as error:
                failure = failure or error
                continue
            present = link.identity.serial_number
            if present == lost.serial_number:
                return link
            link.close()
            failure = LightControllerError(
                f"{port}: light controller {present} is there in place of {lost.serial_number}; "
                f"plug {lost.serial_number} in again, or open the rig again to use {present}"
            )
        if time.monotonic() >= deadline_s:
            raise failure or LightControllerError(
                f"light controller {lost.serial_number} is not plugged in any more"
            )
        time.sleep(_PAUSE_S)
