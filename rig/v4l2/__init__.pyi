from .camera import V4l2Camera
from .camera_list import ListedCamera, device_path, list_cameras
from .controls import Control
from .device import OfferedFormat, V4l2Device
from .output import V4l2Output
from .pixel_formats import PIXEL_FORMATS
from .pixel_packing import PACKINGS

__all__ = [
    "PACKINGS",
    "PIXEL_FORMATS",
    "Control",
    "ListedCamera",
    "OfferedFormat",
    "V4l2Camera",
    "V4l2Device",
    "V4l2Output",
    "device_path",
    "list_cameras",
]
