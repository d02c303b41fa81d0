"""Captured sets and everything a person or a line does with them; the command line on top.

>>> from capture import CapturedSet, capture_set

    captured = capture_set(rig, label="oak")      # LEDs, frames, checks -> CapturedSet
    captured.save("oak-001.ome.tif")              # one OME-TIFF, whole or not at all
    surface = CapturedSet.load("oak-001.ome.tif").solve()

No photometric or spectral mathematics here: that is `classify`. No device driver: that is `rig`.
"""

from .acquisition import capture_set
from .captured_set import CapturedSet
from .errors import SetRejected
from .image_import import import_images
from .set_metadata import SetMetadata

__all__ = ["CapturedSet", "SetMetadata", "SetRejected", "capture_set", "import_images"]
