"""The rig: LEDs over a serial line, frames from a camera, and the simulated rig below both.

>>> from rig import open_rig

    with open_rig("sim") as rig:              # or the path of a rig.toml
        rig.lights.select(0)                  # LED 0 alone -> Switch, with the time of it
        rig.camera.read(timeout_s=1.0)        # the oldest frame in the queue -> Frame

The drivers never know that they talk to a simulation: it is a pty, a firmware and a frame queue
below them. No classification here, and nothing about sessions or stations.
"""

from .camera import Camera, CameraInfo, Frame, FrameFlag
from .config import Placement, RigConfig, load_config
from .errors import CameraError, ConfigError, HardwareError, LightControllerError
from .lights import ControllerIdentity, LightController, Switch
from .rig import Rig, open_rig
from .simulation import Simulation, surface_names

__all__ = [
    "Camera",
    "CameraError",
    "CameraInfo",
    "ConfigError",
    "ControllerIdentity",
    "Frame",
    "FrameFlag",
    "HardwareError",
    "LightController",
    "LightControllerError",
    "Placement",
    "Rig",
    "RigConfig",
    "Simulation",
    "Switch",
    "load_config",
    "open_rig",
    "surface_names",
]
