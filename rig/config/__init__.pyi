from .camera import PIXEL_FORMAT_BITS, CameraConfig
from .fault_plan import FaultPlan, FrameFault
from .lights import AUTO, LightsConfig
from .rig import RigConfig, load_config
from .sequence_plan import SequencePlan, plan_sequence
from .simulation import Placement, SimulationConfig
from .toml_edit import store_values

__all__ = [
    "AUTO",
    "PIXEL_FORMAT_BITS",
    "CameraConfig",
    "FaultPlan",
    "FrameFault",
    "LightsConfig",
    "Placement",
    "RigConfig",
    "SequencePlan",
    "SimulationConfig",
    "load_config",
    "plan_sequence",
    "store_values",
]
