from .acquisition import capture_set
from .errors import SetRejected
from .sets import CapturedSet, SetMetadata, import_images

__all__ = ["CapturedSet", "SetMetadata", "SetRejected", "capture_set", "import_images"]
