"""Everything that is looked at before a rig is trusted, and what to do about what is found.

`diagnosis` goes through it all; each other file looks at one thing. Nothing else needs any of it.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
