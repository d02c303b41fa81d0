"""The PS4 engine: images under known lights in, surface, spectra and texture class out.

>>> from classify import Lighting, TextureLibrary, photometric_stereo

    images + Lighting --photometric_stereo--> SurfaceEstimate --surface_spectra--> Spectra
    SurfaceEstimate --TextureLibrary.classify--> Match

Arrays and small frozen dataclasses only: no cameras, no ports, no captured-set files, no printing.
"""

from .errors import InputError, LibraryError, Ps4rigError
from .evaluation import Evaluation, Trial, evaluate
from .height import integrate_gradients
from .library import Match, TextureLibrary
from .lighting import Lighting
from .solver import METHODS, Method, photometric_stereo
from .spectra import Spectra, surface_spectra
from .surface import SurfaceEstimate

__all__ = [
    "METHODS",
    "Evaluation",
    "InputError",
    "LibraryError",
    "Lighting",
    "Match",
    "Method",
    "Ps4rigError",
    "Spectra",
    "SurfaceEstimate",
    "TextureLibrary",
    "Trial",
    "evaluate",
    "integrate_gradients",
    "photometric_stereo",
    "surface_spectra",
]
