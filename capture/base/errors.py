"""Errors of sets and calibrations, and the causes that an import may accept."""

from enum import StrEnum

from classify.base.errors import InputError, Ps4rigError


class SetRejected(Ps4rigError):  # noqa: N818 - a verdict on a set, not an error of the program
    """A set failed its checks and is not written; the message names every cause."""

    exit_status = 1


class CalibrationError(InputError):
    """A calibration file that cannot be read, or does not hold for a set."""


class ImportCause(StrEnum):
    """Causes for which photographs are refused; ``import --accept`` takes these names."""

    EQUAL_IMAGES = "equal-images"
    LIGHT_ORDER = "light-order"
    RESIDUAL = "residual"
    SATURATION = "saturation"
    DARK = "dark"
    LIGHT_KEYS = "light-keys"
