"""The light controller: found, opened, told what to light, watched, flashed.

`driver` has the commands, `link` one open line below it, `serial_line` and `wire` the bytes.
Whether a board or a simulated one answers is not known here.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
