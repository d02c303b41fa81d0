"""What lies below the simulated camera, and what an ideal camera would see of it.

Surfaces are made (`synthetic`) or scanned (`material_folder`), laid and turned (`surfaces`), and
lit (`render`). No time, no noise and no bits: those are in `simulation`.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
