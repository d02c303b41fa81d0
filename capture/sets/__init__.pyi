from .archive import find_sets, output_folders
from .captured_set import CapturedSet
from .image_import import import_images
from .light_list import load_light_list
from .metadata import SetMetadata

__all__ = [
    "CapturedSet",
    "SetMetadata",
    "find_sets",
    "import_images",
    "load_light_list",
    "output_folders",
]
