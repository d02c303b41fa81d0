"""Limits of a texture: measured on its good parts, or set by people, which teaching keeps."""

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence

from capture.station.domain.limits import ROWS, GeneralLimits, Limits
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import RecipeFolder
from capture.station.domain.taught import Taught
from capture.station.judge.judge import STOP_LED_LEVEL, relative_levels
from classify.base.errors import InputError
from classify.base.models import read_toml_as
from classify.confidence import tolerance_factor
from rig.acceptance import WEAK_LED_SHARE

# Least relative standard deviation of measures of good parts: different patches of one simulated
# texture differ by this much (`tests/capture/station/judge/test_teaching.py`). Without it,
# captures of one and the same part would give limits that the next part exceeds.
_MIN_SPREAD = 0.01
# Least upper limit of Sdq, for parts without any slope: one grey value of 12 bits is 0.001 of a
# signal of a quarter of full scale.
_MIN_SDQ = 0.001
# Margin on limits of shares of pixels: a share that is 0 on all taught parts may be this on others.
_SHARE_MARGIN = 0.005
# Ratio of the limit of unscored areas to the largest area on a good part: unscored cells form
# clusters, whose sizes vary.
_UNJUDGED_FACTOR = 2
# Relative departures of albedo and scale that are always within the limits. LEDs may fade to 85 %
# before the station stops, and parts lie at heights that differ by a hundredth of their distance.
_ALBEDO_MARGIN, _SCALE_MARGIN = 0.15, 0.01
# Least handedness: half way between the taught texture, 1, and its mirror image, -1.
_HANDEDNESS_LIMIT = 0.0
# Largest limit of the log distance. A larger one, from three very different parts, is left out, and
# the limit of the library holds.
_MAX_LOG_DISTANCE = math.log(1000.0)
LimitsOf = Mapping[str, Limits]


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
    # Distances and scales are taken as log-normal, all other measures as normal.
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


def least_led_level(signals: Sequence[Sequence[float]], means: Sequence[float]) -> float:
    """Least level of an LED by brightness, from the light signals of good parts and their means.

    The slopes of a part, too, change its brightness under one light more than under another.
    """
    if len(signals) < 2:
        return STOP_LED_LEVEL
    losses = []
    for levels in signals:
        ratios = [level / mean for level, mean in zip(levels, means, strict=True)]
        losses.append(-math.log(max(min(relative_levels(ratios)), WEAK_LED_SHARE)))
    return min(STOP_LED_LEVEL, max(WEAK_LED_SHARE, math.exp(-_limit(losses))))


def level_remarks(taught: Taught) -> Iterator[str]:
    """Yield a remark on each texture with which a weak LED is not detected."""
    for name, texture in taught.textures.items():
        least = texture.least_led_level
        if least < STOP_LED_LEVEL:
            yield (
                f"{name}: the brightness of good parts varies, and their images do not show the "
                f"levels of the LEDs: an LED is detected below {least:.0%} of its level, not below "
                f"{STOP_LED_LEVEL:.0%}; run ps4rig calibrate plate if the rig has no calibration"
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
    """Upper tolerance limit of values, with a least relative standard deviation."""
    mean = statistics.fmean(values)
    spread = max(statistics.stdev(values), min_relative_spread * abs(mean))
    return mean + tolerance_factor(len(values)) * spread


def limits_measured_before(files: RecipeFolder, recipe: Recipe) -> LimitsOf | None:
    """Return the limits that the last teaching measured; None if they are missing."""
    path = files.version(recipe.version).measured
    try:
        return read_toml_as(path, Recipe, "was not kept").limits_of
    except InputError:
        return None


def manual_limits(present: LimitsOf, measured: LimitsOf | None) -> LimitsOf:
    """Return the limits of each texture that differ from the `measured` ones.

    Without `measured`, all limits that teaching can measure count as measured.
    """
    manual = {}
    for texture, limits in present.items():
        if measured is None:
            values = {name: value for name, value in limits if not ROWS[name].of_teaching}
        else:
            taught = dict(measured.get(texture, Limits()))
            values = {name: value for name, value in limits if value != taught[name]}
        manual[texture] = Limits.model_validate(values)
    return manual


def with_manual_limits(measured: LimitsOf, manual: LimitsOf) -> dict[str, Limits]:
    """Return measured limits, replaced by the limits that people set."""
    return {
        texture: limits.model_copy(
            update=manual.get(texture, Limits()).model_dump(exclude_none=True)
        )
        for texture, limits in measured.items()
    }


def kept_remarks(measured: LimitsOf, manual: LimitsOf) -> Iterator[str]:
    """Yield a remark on each limit that people set, with the measured one."""
    for texture, limits in manual.items():
        taught = dict(measured.get(texture, Limits()))
        for name, value in limits.model_dump(exclude_none=True).items():
            replaced = taught[name]
            note = "" if replaced is None else f"; the taught parts give {_text(replaced)}"
            yield (
                f"limits_of.{texture}.{name} = {_text(value)} was set by somebody and stays{note}. "
                "Remove it from the recipe and teach again to undo that"
            )


def replaced_remarks(before: LimitsOf, after: LimitsOf) -> Iterator[str]:
    """Yield a remark on each limit that teaching replaced."""
    for texture, limits in before.items():
        now = dict(after.get(texture, Limits()))
        for name, value in limits:
            if value is not None and value != now[name]:
                place = f"limits_of.{texture}.{name}"
                yield f"{place} = {_text(value)} is replaced by {_text(now[name])}"


def _text(value: object) -> str:
    if isinstance(value, tuple | list):
        return ", ".join(map(_text, value))
    return (
        f"{value:.4g}" if isinstance(value, float) else "no limit" if value is None else str(value)
    )
