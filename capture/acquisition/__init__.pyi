from .attempts import capture_set
from .timing import compared_configs, measure_set_timing

__all__ = [
    "capture_set",
    "compared_configs",
    "measure_set_timing",
]
