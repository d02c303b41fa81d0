from .solver import photometric_stereo

__all__ = [
    "photometric_stereo",
]
