"""What the lights alone decide, and what the images say about the lights.

`algebra` makes the constants of the solvers; `balance`, `agreement` and `order` find out from four
images how strong the lights are, whether each image is of its light, and of which.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
