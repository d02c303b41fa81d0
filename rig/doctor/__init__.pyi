from .check import Check
from .diagnosis import diagnose

__all__ = [
    "Check",
    "diagnose",
]
