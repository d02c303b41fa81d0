"""What can go wrong with a rig."""

from dataclasses import dataclass

from classify.errors import InputError, Ps4rigError

__all__ = [
    "CameraError",
    "ConfigError",
    "ControlError",
    "ControlFault",
    "HardwareError",
    "LightControllerError",
]


class ConfigError(InputError):
    """A rig configuration that cannot be used; the message names file and field."""


class HardwareError(Ps4rigError):
    """The hardware is not there, does not answer, or answers wrongly."""

    exit_status = 3


class LightControllerError(HardwareError):
    """The LED controller or the serial line to it. What the LEDs do is unknown until it is closed:
    its watchdog puts them out.
    """


class CameraError(HardwareError):
    """The camera delivers no frame, or not the frames it was asked for."""


@dataclass(frozen=True)
class ControlFault:
    """One control of a camera that does not hold what was asked of it.

    Attributes
    ----------
    control
        Its name.
    seen
        What was asked and what was found, with the name.
    advice
        The way out.
    """

    control: str
    seen: str
    advice: str


class ControlError(CameraError):
    """Controls of a camera that do not hold; the message names all of them.

    Parameters
    ----------
    path
        The camera's.
    faults
        One or more.
    """

    def __init__(self, path: str, *faults: ControlFault) -> None:
        self.faults = faults
        advices = dict.fromkeys(fault.advice for fault in faults)
        super().__init__(f"{path}: " + "; ".join([*(fault.seen for fault in faults), *advices]))
