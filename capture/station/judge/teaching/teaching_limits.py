"""Limits of a texture, from the measures of its good parts."""

import math
import statistics
from collections.abc import Mapping, Sequence

from capture.station.domain.limits import GeneralLimits, Limits
from classify.confidence import tolerance_factor

# Least relative spread of Sdq and shadow between good parts: different patches of one simulated
# texture differ by this much (`tests/capture/station/judge/test_teaching.py`). Without it,
# captures of one and the same part would give limits that the next part exceeds.
_MIN_SPREAD = 0.01
# Least upper limit of Sdq, for parts without any slope: one grey value of 12 bits is 0.001 of a
# signal of a quarter of full scale.
_MIN_SDQ = 0.001
# Margin on limits of shares of pixels: a share that is 0 on all taught parts may be this on others.
_SHARE_MARGIN = 0.005
# Ratio of the limit of unscored areas to the largest one on a good part; unscored cells are
# clustered.
_UNJUDGED_FACTOR = 2
# Relative departures of albedo and scale that are always within the limits. LEDs may fade to 85 %
# before the station stops, and parts lie at heights that differ by a hundredth of their distance.
_ALBEDO_MARGIN, _SCALE_MARGIN = 0.15, 0.01
# Least handedness: half way between the taught texture, 1, and its mirror image, -1.
_HANDEDNESS_LIMIT = 0.0
# Largest limit of the log distance. A larger one, from three very different parts, is left out, and
# the limit of the library holds.
_MAX_LOG_DISTANCE = math.log(1000.0)


def limits_of_texture(
    distances: Sequence[float],
    sdqs: Sequence[float],
    shadow_fractions: Sequence[float],
    unmeasured_fractions: Sequence[float],
    albedos: Sequence[float],
    scale_deviation: float,
    *,
    has_handedness: bool,
) -> Limits:
    """Tolerance limits for 99 % of good parts, with 95 % confidence."""
    # Distances and scale count as log-normal, and all other measures as normal.
    logs = [math.log(distance) for distance in distances if distance > 0.0]
    log_limit = max(_limit(logs, 0.0), *logs) if len(logs) > 1 else math.inf
    lowest_sdq = max(0.0, -_limit([-sdq for sdq in sdqs]))
    albedo = statistics.fmean(albedos)
    darkest = max(0.0, min(-_limit([-value for value in albedos]), (1.0 - _ALBEDO_MARGIN) * albedo))
    brightest = max(_limit(albedos), (1.0 + _ALBEDO_MARGIN) * albedo)
    factor = tolerance_factor(len(albedos))
    scale = math.exp(max(factor * scale_deviation, _SCALE_MARGIN))
    return Limits(
        albedo=(darkest, brightest),
        scale=(1.0 / scale, scale),
        handedness=_HANDEDNESS_LIMIT if has_handedness else None,
        distance=math.exp(log_limit) if log_limit < _MAX_LOG_DISTANCE else None,
        sdq=(lowest_sdq, max(_MIN_SDQ, _limit(sdqs))),
        shadow_fraction=min(1.0, _SHARE_MARGIN + _limit(shadow_fractions)),
        unmeasured_fraction=min(1.0, _SHARE_MARGIN + _limit(unmeasured_fractions)),
    )


def with_unjudged(limits: Limits, general: GeneralLimits, areas_px: Sequence[int]) -> Limits:
    """Return `limits` that accept the largest unscored area of each good part."""
    largest_px = max(areas_px, default=0)
    if largest_px <= general.unjudged_px:
        return limits
    return limits.model_copy(update={"unjudged_px": _UNJUDGED_FACTOR * largest_px})


def general_limits(limits: GeneralLimits, of_textures: Mapping[str, Limits]) -> GeneralLimits:
    """Return general limits whose `unmeasured_fraction` no texture exceeds."""
    shares = [texture_limits.unmeasured_fraction or 0.0 for texture_limits in of_textures.values()]
    largest_share = max([limits.unmeasured_fraction, *shares])
    return limits.model_copy(update={"unmeasured_fraction": largest_share})


def _limit(values: Sequence[float], min_relative_spread: float = _MIN_SPREAD) -> float:
    """Upper tolerance limit of values; their spread is at least a share of their mean."""
    mean = statistics.fmean(values)
    spread = max(statistics.stdev(values), min_relative_spread * abs(mean))
    return mean + tolerance_factor(len(values)) * spread
