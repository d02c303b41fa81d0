from .camera import Camera, CameraInfo, Frame, FrameFlag
from .config import FaultPlan, Placement, RigConfig, SequencePlan, load_config
from .errors import CameraError, ConfigError, HardwareError, LightControllerError
from .lights import (
    ControllerIdentity,
    LightController,
    LightStep,
    RunningSequence,
    SequenceReport,
    Switch,
)
from .rig import Rig, open_rig
from .scene import EQUAL_SPECTRUM_TWINS, SYNTHETIC_30, SYNTHETIC_TEXTURES, synthetic_surface
from .simulation import Simulation, surface_names
from .v4l2 import ListedCamera, list_cameras

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
