from .curvature import Curvature, surface_curvature
from .errors import InputError, LibraryError, Ps4rigError
from .evaluation import Evaluation, Trial, evaluate
from .height import integrate_gradients
from .library import TextureLibrary
from .lighting import Lighting
from .local_relief import local_relief
from .match import Match
from .methods import CLASSIFIER_NAMES, METHODS, Method
from .noise import SensorNoise
from .relighting import relight
from .roughness import Roughness, surface_roughness
from .solver import photometric_stereo
from .spectra import Spectra, surface_spectra
from .surface import SurfaceEstimate

__all__ = [
    "CLASSIFIER_NAMES",
    "METHODS",
    "Curvature",
    "Evaluation",
    "InputError",
    "LibraryError",
    "Lighting",
    "Match",
    "Method",
    "Ps4rigError",
    "Roughness",
    "SensorNoise",
    "Spectra",
    "SurfaceEstimate",
    "TextureLibrary",
    "Trial",
    "evaluate",
    "integrate_gradients",
    "local_relief",
    "photometric_stereo",
    "relight",
    "surface_curvature",
    "surface_roughness",
    "surface_spectra",
]
