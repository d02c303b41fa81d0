from .cameras.camera import Camera, CameraInfo, Frame, ListedCamera
from .cameras.kinds import list_cameras
from .config.lights import SequencePlan
from .config.rig import RigConfig, load_config
from .config.simulation import Defect, Placement
from .errors import CameraError, ConfigError, HardwareError, LightControllerError
from .lights.driver import LightController, Switch
from .lights.link import ControllerIdentity
from .lights.sequence import LightStep, RunningSequence, SequenceReport
from .rig import Rig, open_rig
from .scene.synthetic import (
    EQUAL_SPECTRUM_TWINS,
    SYNTHETIC_30,
    SYNTHETIC_TEXTURES,
    synthetic_surface,
)
from .simulation.rig import Simulation
from .simulation.scenes import surface_names

__all__ = [
    "EQUAL_SPECTRUM_TWINS",
    "SYNTHETIC_30",
    "SYNTHETIC_TEXTURES",
    "Camera",
    "CameraError",
    "CameraInfo",
    "ConfigError",
    "ControllerIdentity",
    "Defect",
    "Frame",
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
