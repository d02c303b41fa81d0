from .acquisition import capture_set
from .captured_set import CapturedSet
from .errors import SetRejected
from .image_import import import_images
from .set_metadata import SetMetadata

__all__ = ["CapturedSet", "SetMetadata", "SetRejected", "capture_set", "import_images"]
