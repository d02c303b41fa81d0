from .base.errors import InputError, LibraryError, Ps4rigError
from .calibration.calibration import Calibration
from .defects.defect_map import DefectMap, DefectRegion, regions_of
from .defects.defect_model import DefectModel
from .defects.learning import learn_defects
from .images import SensorNoise
from .library.evaluation import Evaluation, Trial, evaluate
from .library.match import Match
from .library.texture_library import TextureLibrary
from .lighting import Lighting
from .methods import CLASSIFIER_NAMES, METHODS, Method
from .relief.curvature import Curvature, surface_curvature
from .relief.height import integrate_gradients, local_relief
from .relief.relighting import relight
from .relief.roughness import Roughness, surface_roughness
from .solvers.solver import photometric_stereo
from .surface.estimate import SurfaceEstimate
from .texture.spectra import Spectra, surface_spectra

__all__ = [
    "CLASSIFIER_NAMES",
    "METHODS",
    "Calibration",
    "Curvature",
    "DefectMap",
    "DefectModel",
    "DefectRegion",
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
    "learn_defects",
    "local_relief",
    "photometric_stereo",
    "regions_of",
    "relight",
    "surface_curvature",
    "surface_roughness",
    "surface_spectra",
]
