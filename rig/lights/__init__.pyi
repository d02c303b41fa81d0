from .discovery import SerialPort, find_controller, known_port, list_serial_ports, ports_to_try
from .driver import LightController, Switch
from .heartbeat import TendedClock
from .link import ControllerIdentity, ControllerLink
from .sequence import LightStep, RunningSequence, SequencePlan, SequenceReport, plan_sequence

__all__ = [
    "ControllerIdentity",
    "ControllerLink",
    "LightController",
    "LightStep",
    "RunningSequence",
    "SequencePlan",
    "SequenceReport",
    "SerialPort",
    "Switch",
    "TendedClock",
    "find_controller",
    "known_port",
    "list_serial_ports",
    "plan_sequence",
    "ports_to_try",
]
