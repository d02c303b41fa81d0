from .discovery import SerialPort, find_controller, known_port, list_serial_ports, ports_to_try
from .driver import LightController, Switch
from .heartbeat import TendedClock
from .link import ControllerIdentity, ControllerLink
from .sequence import LightStep, RunningSequence, SequenceReport

__all__ = [
    "ControllerIdentity",
    "ControllerLink",
    "LightController",
    "LightStep",
    "RunningSequence",
    "SequenceReport",
    "SerialPort",
    "Switch",
    "TendedClock",
    "find_controller",
    "known_port",
    "list_serial_ports",
    "ports_to_try",
]
