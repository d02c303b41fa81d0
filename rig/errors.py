"""What can go wrong with a rig."""

from classify.errors import InputError, Ps4rigError

__all__ = ["CameraError", "ConfigError", "HardwareError", "LightControllerError"]


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
