"""The exposure that suits a specimen."""

import math

from classify.base.errors import InputError
from rig import RigConfig, list_cameras, open_rig
from rig.doctor.cameras import exposure_range_ms
from rig.doctor.light_images import capture_light_images, rate_exposure

# Each round makes a saturated image 2.5 times darker: six rounds reach 1/100 of the first exposure.
_ROUNDS = 6
# Below the shortest exposure of common cameras, 0.02 ms.
_SHORTEST_MS = 0.01


def find_exposure_ms(config: RigConfig) -> float:
    """Find an exposure in ms that `rate_exposure` calls good, beginning with that of `config`.

    A dark specimen gets the longest exposure that fits into a frame, even if that is not good.
    """
    listed = [] if config.is_simulated else list_cameras()
    exposure_ms = config.camera.exposure_ms
    for _ in range(_ROUNDS):
        with open_rig(config.with_changes(camera={"exposure_ms": exposure_ms})) as rig:
            rating = rate_exposure(capture_light_images(rig))
            shortest_ms, longest_ms = exposure_range_ms(rig.camera, listed, config.camera)
        if rating.is_good:
            return exposure_ms
        # To whole microseconds, rounded down: the longest still has to fit into a frame.
        wanted_us = math.floor(1e3 * min(exposure_ms * rating.factor, longest_ms) + 1e-6)
        if rating.factor > 1.0 and wanted_us / 1e3 <= exposure_ms:
            return exposure_ms  # dark, but nothing longer fits into a frame
        if wanted_us / 1e3 < max(shortest_ms, _SHORTEST_MS):
            break
        exposure_ms = wanted_us / 1e3
    raise InputError(
        f"no exposure down to {exposure_ms:g} ms suits the specimen; dim the LEDs, or close the "
        "aperture"
    )
