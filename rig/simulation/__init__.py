"""What is hardware in a real rig: board and LEDs, camera and sensor, and what goes wrong with them.

What the camera looks at is in `scene`, the controller in `firmware_sim`. The drivers above are the
real ones; `devices` puts the same below real device files, for other programs.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
