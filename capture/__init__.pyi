from .acquisition.attempts import capture_set
from .errors import SetRejected
from .sets.captured_set import CapturedSet
from .sets.image_import import import_images
from .sets.metadata import SetMetadata

__all__ = ["CapturedSet", "SetMetadata", "SetRejected", "capture_set", "import_images"]
