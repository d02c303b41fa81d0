"""Captured sets and everything a person or a line does with them; the command line on top.

>>> from capture import CapturedSet, capture_set

    captured = capture_set(rig, label="oak")      # LEDs, frames, checks -> CapturedSet
    captured.save("oak-001.ome.tif")              # one OME-TIFF, whole or not at all
    surface = CapturedSet.load("oak-001.ome.tif").solve()

No photometric or spectral mathematics here: that is `classify`. No device driver: that is `rig`.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
