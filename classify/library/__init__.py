"""Trained references, what they say of a surface, and how often they are right.

`ps4lib` is the file of a library.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
