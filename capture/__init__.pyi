from .acquisition.attempts import capture_set
from .base.errors import SetRejected
from .calibration.ps4cal import CalibrationFile
from .sets.captured_set import CapturedSet
from .sets.metadata import SetMetadata
from .sets.photographs import import_images

__all__ = [
    "CalibrationFile",
    "CapturedSet",
    "SetMetadata",
    "SetRejected",
    "capture_set",
    "import_images",
]
