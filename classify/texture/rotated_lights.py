"""One surface under lights that were turned: what a turned part would have looked like.

Four lights leave errors wherever two of them are in shadow, and where that is depends on how the
texture lies to the lights: a turned part has its errors elsewhere. From one training set, as far
as its surface is known, the others can be had by computing: relit with attached and cast shadows
under lights turned the other way, and solved again. No pixel is resampled.
"""

from __future__ import annotations

from collections.abc import Iterator

from classify.lighting import Lighting
from classify.methods import METHODS
from classify.relief.height import integrate_gradients
from classify.relief.relighting import relight
from classify.relief.shadows import cast_shadow
from classify.solvers.solver import photometric_stereo
from classify.surface.estimate import SurfaceEstimate

__all__ = ["under_rotated_lights"]

_STEPS = 4
# With less of the surface in shadow the errors are those of noise, which do not turn.
_LEAST_SHADOW = 0.01


def under_rotated_lights(surface: SurfaceEstimate) -> Iterator[SurfaceEstimate]:
    """Estimates of the same pixels as if the part had been turned, lights staying where they are.

    The part counts as turned by three steps of a quarter of the angle between lights; after four
    the ring of lights is the same again. Yields nothing for an estimate that does not know its
    lights or comes from PS3, and where shadow is too rare to matter.

    Parameters
    ----------
    surface
        As it was solved; its slopes are relative to the image, and stay so.
    """
    lighting = surface.lighting
    # The versions of PS3 choose lights by where they stand: turned, they would be others.
    if lighting is None or surface.method not in METHODS or surface.method.startswith("ps3"):
        return
    if surface.shadow_mask.mean() < _LEAST_SHADOW:
        return
    height = integrate_gradients(surface.p, surface.q)
    step_deg = 360.0 / len(lighting) / _STEPS
    for step in range(1, _STEPS):
        turned = Lighting.from_angles(
            list(lighting.tilts_deg - step * step_deg), list(lighting.slants_deg)
        )
        images = relight(surface, turned)
        for image, direction in zip(images, turned.directions, strict=True):
            image[cast_shadow(height, direction)] = 0.0
        # No noise is added: the surface holds that of its own images already.
        yield photometric_stereo(images, turned, surface.method)
