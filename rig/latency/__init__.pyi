from .camera import CameraLatency, Whole, measure_latency, without_timing
from .switch import SwitchLatency, measure_switch_latency

__all__ = [
    "CameraLatency",
    "SwitchLatency",
    "Whole",
    "measure_latency",
    "measure_switch_latency",
    "without_timing",
]
