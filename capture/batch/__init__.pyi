from .runner import Batch

__all__ = [
    "Batch",
]
