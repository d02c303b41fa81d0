from .camera import Camera, CameraInfo, Frame, FrameFlag
from .camera_list import ListedCamera, list_cameras
from .config import Placement, RigConfig, load_config
from .errors import CameraError, ConfigError, HardwareError, LightControllerError
from .fault_plan import FaultPlan
from .light_sequence import LightStep, RunningSequence, SequencePlan, SequenceReport
from .lights import ControllerIdentity, LightController, Switch
from .rig import Rig, open_rig
from .simulation import Simulation, surface_names
from .synthetic import EQUAL_SPECTRUM_TWINS, SYNTHETIC_30, SYNTHETIC_TEXTURES, synthetic_surface

__all__ = [
    "EQUAL_SPECTRUM_TWINS",
    "SYNTHETIC_30",
    "SYNTHETIC_TEXTURES",
    "Camera",
    "CameraError",
    "CameraInfo",
    "ConfigError",
    "ControllerIdentity",
    "FaultPlan",
    "Frame",
    "FrameFlag",
    "HardwareError",
    "LightController",
    "LightControllerError",
    "LightStep",
    "ListedCamera",
    "Placement",
    "Rig",
    "RigConfig",
    "RunningSequence",
    "SequencePlan",
    "SequenceReport",
    "Simulation",
    "Switch",
    "list_cameras",
    "load_config",
    "open_rig",
    "surface_names",
    "synthetic_surface",
]
