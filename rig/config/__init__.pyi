from .camera import PIXEL_FORMAT_BITS, CameraConfig
from .fault_plan import FaultPlan
from .rig import AUTO, LightsConfig, Placement, RigConfig, SimulationConfig, load_config
from .toml_edit import store_values

__all__ = [
    "AUTO",
    "PIXEL_FORMAT_BITS",
    "CameraConfig",
    "FaultPlan",
    "LightsConfig",
    "Placement",
    "RigConfig",
    "SimulationConfig",
    "load_config",
    "store_values",
]
