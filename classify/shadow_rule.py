"""Limits for shadow and for surfaces that face away, the same for every solver."""

import numpy as np

# A normal nearer to the horizon than this (a slope of 50) is noise, not surface.
MIN_NORMAL_Z = np.float32(0.02)
# Slopes are divided by the z component of the scaled normal; 1 / 1e-38 is infinite in float32.
MIN_SCALED_Z = np.float32(1e-30)
# A light counts as shadowed where it gives no more than this fraction of the Lambertian prediction.
# The prediction is at least SHADOW_FLOOR of the albedo, so that a pixel that faces away from the
# light (negative prediction, value near zero) counts as well, and so does a black one.
SHADOW_FRACTION = np.float32(0.5)
SHADOW_FLOOR = np.float32(0.1)
# Before anything is solved: a light that gives less than this share of the brightest may be in
# shadow.
MAYBE_SHADOW = 0.2
NO_DROPPED_LIGHT = 255
# A light is dark at a pixel up to DARK standard deviations of the noise without light. This limit
# is at most half of the brightest light: a dark material is all noise, without a shadow. A light is
# also dark up to the share LEAK of the second brightest one (the brightest may be a highlight):
# shadows get light from the surface around them.
DARK = np.float32(3.0)
LEAK = np.float32(0.03)
