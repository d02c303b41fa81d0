"""``rig.toml``: the values that say what the rig consists of; a section, a file.

Nothing is opened here. All other folders of `rig` are told by these values what to do.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
