from .loop import Preview, run_preview
from .server import serving

__all__ = [
    "Preview",
    "run_preview",
    "serving",
]
