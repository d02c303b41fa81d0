from .estimate import FloatMap, SurfaceEstimate

__all__ = [
    "FloatMap",
    "SurfaceEstimate",
]
