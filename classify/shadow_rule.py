"""What counts as shadow, and as facing away, at a pixel: the same for every solver."""

import numpy as np

__all__ = ["MIN_NORMAL_Z", "NO_DROPPED_LIGHT", "SHADOW_FLOOR", "SHADOW_FRACTION"]

# A normal nearer to the horizon than this (a slope of 50) is noise, not surface.
MIN_NORMAL_Z = np.float32(0.02)
# A light counts as shadowed where it gives no more than this fraction of the Lambertian prediction;
# the prediction is taken as at least SHADOW_FLOOR of the albedo, so that a pixel turned away from
# the light (prediction negative, value near zero) counts as well, and one without any light too.
SHADOW_FRACTION = np.float32(0.5)
SHADOW_FLOOR = np.float32(0.1)
NO_DROPPED_LIGHT = 255
