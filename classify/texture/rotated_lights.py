"""One surface under rotated lights, as if the part were rotated under its lights.

Four lights leave errors where two of them are in shadow, and the place of shadows depends on the
orientation of the texture. The estimate of one training set is relit with attached and cast shadows
under lights rotated the other way, and solved again. No pixel is resampled.
"""

from collections.abc import Iterator

from classify.lighting import Lighting
from classify.methods import METHODS
from classify.relief.height import integrate_gradients
from classify.relief.relighting import cast_shadow, relight
from classify.solvers.solver import photometric_stereo
from classify.surface.estimate import SurfaceEstimate

_STEPS = 4
# With less of the surface in shadow, noise causes most errors, whatever the orientation.
_LEAST_SHADOW = 0.01


def under_rotated_lights(surface: SurfaceEstimate) -> Iterator[SurfaceEstimate]:
    """Yield estimates of the same pixels as if the part were rotated, three times.

    Each step is a quarter of the angle between lights; yields nothing without lighting, by PS3, or
    where less than 1 % of the surface is in shadow.
    """
    lighting = surface.lighting
    # PS3 chooses lights by their tilt: rotated, it would choose others.
    if lighting is None or surface.method not in METHODS or surface.method.startswith("ps3"):
        return
    if surface.shadow_mask.mean() < _LEAST_SHADOW:
        return
    height = integrate_gradients(surface.p, surface.q)
    step_deg = 360.0 / len(lighting) / _STEPS
    for step in range(1, _STEPS):
        rotated = Lighting.from_angles(
            list(lighting.tilts_deg - step * step_deg), list(lighting.slants_deg)
        )
        images = relight(surface, rotated)
        for image, direction in zip(images, rotated.directions, strict=True):
            image[cast_shadow(height, direction)] = 0.0
        # The surface contains the noise of its own images; none is added.
        yield photometric_stereo(images, rotated, surface.method)
