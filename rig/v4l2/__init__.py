"""Video for Linux: cameras as drivers give them, and loopback devices to write into.

`abi` and `ioctl` are the kernel's words, `device` and `controls` what can be asked of any video
device, `camera` is one that is set for measurement, `output` the other side of a loopback device.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
