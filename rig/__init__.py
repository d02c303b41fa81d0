"""The rig: LEDs over a serial line, frames from a camera, and their simulation.

>>> from rig import open_rig

    with open_rig("sim") as rig:              # or the path of a rig.toml
        rig.lights.select(0)                  # LED 0 alone -> Switch, with its time
        rig.camera.read(timeout_s=1.0)        # the oldest frame in the queue -> Frame

The drivers are the same for a simulated rig: below them the real firmware answers on a TCP port,
and frames come from a simulated queue. Nothing here knows of classification, sessions or stations.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
