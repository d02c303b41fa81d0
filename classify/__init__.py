"""The PS4 engine: from images under known lights to surface and texture class.

>>> from classify import Lighting, TextureLibrary, photometric_stereo

    images + Lighting --photometric_stereo--> SurfaceEstimate --surface_spectra--> Spectra
    SurfaceEstimate --TextureLibrary.classify--> Match

Arrays and small frozen dataclasses only: no cameras, no ports, no captured-set files, no printing.
"""

import lazy_loader

# The names are those of __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
