"""Base classes of all exceptions; `rig` and `capture` derive theirs from them."""


class Ps4rigError(Exception):
    """An error reported in one line; the command line then returns `exit_status`."""

    exit_status = 2


class InputError(Ps4rigError):
    """An unusable image, file or option; the message names it and says what to do."""


class ConfigError(InputError):
    """A configuration or plan that cannot be used; the message names file and field."""


class LibraryError(InputError):
    """A texture library that cannot be read, or does not fit the surface."""


class DefectModelError(InputError):
    """A defect model that cannot be read."""


class PieceModelError(InputError):
    """A piece model that cannot be read."""


class CalibrationRejected(Ps4rigError):  # noqa: N818 - a verdict on a measurement, no program error
    """A measurement too bad for a calibration; the message names the cause."""

    exit_status = 1
