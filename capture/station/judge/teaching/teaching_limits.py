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
# Added to limits of shares of pixels: a share that is 0 on all good parts may be this on the next.
_MIN_SHARE = 0.005
# Cells without a score come in groups: the limit is twice the largest area on a good part.
_MORE_UNJUDGED = 2
# Least relative departures of albedo and scale that exceed their limits: LEDs may fade to 85 %
# before the station stops, and parts lie at heights that differ by a hundredth of their distance.
_MIN_ALBEDO, _MIN_SCALE = 0.15, 0.01
# Half way between the taught texture and its mirror image.
_MIN_HANDEDNESS = 0.0
# Logarithm of a distance of 1000. A larger limit, from three very different parts, is left out: the
# library has its own.
_NO_LIMIT = math.log(1000.0)


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
    """Tolerance limits of 99 % of good parts with 95 % confidence, normal, or log-normal for
    distances and scale.
    """
    logs = [math.log(distance) for distance in distances if distance > 0.0]
    log_limit = max(_limit(logs, 0.0), *logs) if len(logs) > 1 else math.inf
    least = max(0.0, -_limit([-sdq for sdq in sdqs]))
    albedo = statistics.fmean(albedos)
    darker = max(0.0, min(-_limit([-value for value in albedos]), (1.0 - _MIN_ALBEDO) * albedo))
    brighter = max(_limit(albedos), (1.0 + _MIN_ALBEDO) * albedo)
    factor = tolerance_factor(len(albedos))
    scale = math.exp(max(factor * scale_deviation, _MIN_SCALE))
    return Limits(
        albedo=(darker, brighter),
        scale=(1.0 / scale, scale),
        handedness=_MIN_HANDEDNESS if has_handedness else None,
        distance=math.exp(log_limit) if log_limit < _NO_LIMIT else None,
        sdq=(least, max(_MIN_SDQ, _limit(sdqs))),
        shadow_fraction=min(1.0, _MIN_SHARE + _limit(shadow_fractions)),
        unmeasured_fraction=min(1.0, _MIN_SHARE + _limit(unmeasured_fractions)),
    )


def with_unjudged(limits: Limits, general: GeneralLimits, found_px: Sequence[int]) -> Limits:
    """Return `limits` that accept the largest area without a score that a good part shows."""
    most_px = max(found_px, default=0)
    if most_px <= general.unjudged_px:
        return limits
    return limits.model_copy(update={"unjudged_px": _MORE_UNJUDGED * most_px})


def general_limits(limits: GeneralLimits, of_textures: Mapping[str, Limits]) -> GeneralLimits:
    """Return general limits whose `unmeasured_fraction` no texture exceeds."""
    shares = [texture_limits.unmeasured_fraction or 0.0 for texture_limits in of_textures.values()]
    most = max([limits.unmeasured_fraction, *shares])
    return limits.model_copy(update={"unmeasured_fraction": most})


def _limit(values: Sequence[float], least_spread: float = _MIN_SPREAD) -> float:
    """Upper tolerance limit of values; their spread is at least `least_spread` of their mean."""
    mean = statistics.fmean(values)
    spread = max(statistics.stdev(values), least_spread * abs(mean))
    return mean + tolerance_factor(len(values)) * spread
