from .noise import SensorNoise, noise_of_images, noise_of_sensor
from .stack import Images, checked_ambient, checked_stack

__all__ = [
    "Images",
    "SensorNoise",
    "checked_ambient",
    "checked_stack",
    "noise_of_images",
    "noise_of_sensor",
]
