"""Errors of a rig."""

from dataclasses import dataclass

from classify.base.errors import ConfigError as ConfigError
from classify.base.errors import Ps4rigError


class HardwareError(Ps4rigError):
    """Hardware that is missing, does not answer, or answers wrongly."""

    exit_status = 3
    device = "rig"  # subclasses name the camera or the lights


class LightControllerError(HardwareError):
    """An error of the LED controller or its serial line.

    The state of the LEDs is unknown until the controller's watchdog puts them out.
    """

    device = "lights"


class CameraError(HardwareError):
    """A camera that delivers no frame, or frames of another kind than configured."""

    device = "camera"


@dataclass(frozen=True)
class CameraFault:
    """A control that does not hold its configured value, or too slow a network; what to do."""

    name: str
    message: str
    advice: str


class ControlError(CameraError):
    """Controls of a camera that do not hold their values; the message names all of them."""

    def __init__(self, path: str, *faults: CameraFault) -> None:
        self.faults = faults
        advice = dict.fromkeys(fault.advice for fault in faults)
        super().__init__(f"{path}: " + "; ".join([*(fault.message for fault in faults), *advice]))
