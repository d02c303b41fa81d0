from .devices import DeviceSimulation
from .rig import Simulation, surface_names
from .sensor import SensorModel

__all__ = [
    "DeviceSimulation",
    "SensorModel",
    "Simulation",
    "surface_names",
]
