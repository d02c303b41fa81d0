"""Reject light images that are saturated, dark, or under another light.

The redundancy of four light images of a matt surface shows faults. If it cannot decide, the images
are compared with a retake in the opposite order, in which a transient fault has other effects.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt

from capture.base.errors import SetRejected
from capture.sets.image_checks import CheckedImages
from capture.sets.metadata import ChecksRecord
from classify import Calibration
from classify.base.arrays import Array, Floats
from classify.lights.agreement import LightAgreement, image_difference
from classify.lights.order import light_order
from rig import acceptance

# Correlation of the ambient image with the shading of an LED above which the LED is reported to
# stay on. test_fault_matrix.py has LEDs that stay on at a third of their level.
_STAYS_ON_CORRELATION = 0.3
# Least number of compared rows and columns: 128 x 128 px show a share of 2 %.
_SHADED_PX = 128


def check_set(
    images: CheckedImages,
    calibration: Calibration,
    retake: Callable[[], Array],
    least_level: float | None = None,
) -> ChecksRecord:
    """Check the images of a set, and compare them with one `retake` if something is undecided.

    An LED that gives at least `least_level` of the others' light is undecided, not rejected.
    """
    calibrated = images.calibrated(calibration)
    _check_different(images)
    ambient_change = _check_ambient(images)
    check_images(images)
    agreement = calibrated.agreement()
    weak_leds = _weak_leds(agreement, calibrated, least_level)
    undecided = (*weak_leds, *_retake_reasons(agreement))
    if undecided:
        _check_retake(images, retake())
        if agreement is None or agreement.levels is None:
            _check_signals(calibrated)
    light_order = _checked_order(calibrated)
    return ChecksRecord.of(agreement, light_order, ambient_change, undecided)


def check_images(images: CheckedImages) -> None:
    """Reject images that are saturated or dark, by the limits of `rig.acceptance`."""
    causes: list[str] = []
    full_scale, ambient_mean = images.full_scale, images.ambient_mean
    if ambient_mean > acceptance.MAX_AMBIENT_SHARE * full_scale:
        causes.append(
            f"ambient light fills {ambient_mean / full_scale:.0%} of the range; shield the rig"
        )
    signals = images.signals
    brightest = float(signals.max())
    shares = images.saturated_shares()
    for name, saturated, signal in zip(images.names, shares, signals, strict=True):
        if saturated > acceptance.MAX_SATURATED_SHARE:
            causes.append(
                f"{name}: {saturated:.1%} of the pixels are saturated (limit "
                f"{acceptance.MAX_SATURATED_SHARE:.0%}); shorten the exposure"
            )
        elif signal < acceptance.MIN_SIGNAL_SHARE * full_scale:
            causes.append(
                f"{name}: dark, {signal:.1f} of {full_scale} above ambient light: the LED is dead "
                "or always on, or the exposure too short; run ps4rig rig doctor"
            )
        elif signal < acceptance.DEAD_LED_SHARE * brightest:
            causes.append(
                f"{name}: only {signal / brightest:.0%} of the brightest light (limit "
                f"{acceptance.DEAD_LED_SHARE:.0%}); uncover or replace the LED"
            )
    if causes:
        raise SetRejected("set rejected: " + "; ".join(causes))


def _check_ambient(images: CheckedImages) -> float | None:
    """Difference of two ambient images as a share of the brightest signal; None for one image."""
    if images.later_ambient is None:
        return None
    signal = max(1.0, float(images.signals.max()))
    change = image_difference(images.ambient, images.later_ambient, signal, images.noise)
    if change > acceptance.MAX_AMBIENT_CHANGE:
        raise SetRejected(
            f"set rejected: the two ambient images differ by {change:.1%} of an LED's light (limit "
            f"{acceptance.MAX_AMBIENT_CHANGE:.0%}): an LED stays on, a frame was black, torn or "
            "older than its time stamp, or other light changed; shield the rig, then run ps4rig "
            "rig doctor"
        )
    return change


def check_target(images: CheckedImages) -> ChecksRecord:
    """Check images of a calibration target for faults that no target causes.

    Lights may be unequal and near, a sphere may be dark, and a sheet has no shading.
    """
    _check_different(images)
    is_bright = float(images.signals.max()) >= acceptance.MIN_SIGNAL_SHARE * images.full_scale
    return ChecksRecord.of(None, "undecided", _check_ambient(images) if is_bright else None)


def _retake_reasons(agreement: LightAgreement | None) -> tuple[str, ...]:
    """Reasons for a retake, in words, by the agreement of the images; empty if none."""
    if agreement is None:
        return ("the redundancy needs four lights in general position",)
    causes, residual = [], agreement.redundancy_residual
    if residual > acceptance.MAX_REDUNDANCY_RESIDUAL:
        causes.append(f"the redundancy residual is {residual:.1%} of the signal")
    if agreement.compared_rows < acceptance.MIN_COMPARED_ROW_SHARE:
        causes.append(f"all lights together reach {agreement.compared_rows:.0%} of the rows")
    if agreement.levels is None:
        causes.append("no LED levels explain the light images")
    elif agreement.level_error > acceptance.MAX_LED_LEVEL_ERROR:
        causes.append(f"LED levels are known to {agreement.level_error:.1%} only")
    return tuple(causes)


def _check_retake(images: CheckedImages, retaken: Array) -> None:
    """Reject light images that a retake does not confirm."""
    ambient, signals = images.ambient_mean, images.signals
    for name, first, second, signal in zip(
        images.names, images.images, retaken, signals.tolist(), strict=True
    ):
        change = image_difference(first, second, signal, images.noise)
        change = max(change, abs(float(second.mean()) - ambient - signal) / signal)
        if change > acceptance.MAX_RETAKE_CHANGE:
            raise SetRejected(
                f"set rejected: the retake under {name} differs by {change:.1%} (limit "
                f"{acceptance.MAX_RETAKE_CHANGE:.0%}): the LED flickers, the exposure drifts, a "
                "frame was torn or showed another light, or the part moved; keep the part still, "
                "then run ps4rig rig doctor"
            )


def _check_signals(images: CheckedImages) -> None:
    """Reject light images of which one is far darker than the others."""
    shares = images.signals / images.lighting.intensities
    shares /= np.median(shares)
    for name, share in zip(images.names, shares.tolist(), strict=True):
        if share < acceptance.WEAK_LED_SHARE:
            raise SetRejected(
                f"set rejected: {name} gives {share:.0%} of the others' light (limit "
                f"{acceptance.WEAK_LED_SHARE:.0%}); uncover or replace the LED, or move the part "
                "out of shadow"
            )


def _checked_order(images: CheckedImages) -> Literal["confirmed", "undecided"]:
    """Whether the shading confirms the order of the lights; undecided for other than four."""
    lighting = images.lighting
    if len(lighting) != 4:
        return "undecided"
    order = light_order(
        images.images, lighting, ambient=images.ambient, full_scale=images.full_scale
    )
    if order.is_refuted:
        best = ", ".join(f"{tilt:g}" for tilt in lighting.tilts_deg[list(order.plausible[0])])
        raise SetRejected(
            "set rejected: the LEDs are not in the order of lights.tilts_deg; by their shading "
            f"the light images were captured under tilts {best}; exchange the cables of the LEDs, "
            "or set lights.tilts_deg to this order; if an LED is dead, replace it"
        )
    return "confirmed" if order.is_confirmed else "undecided"


def _check_different(images: CheckedImages) -> None:
    """Reject images of the camera of which two hold the same frame."""
    for earlier, later, equal, _ in images.equal_rows():
        raise SetRejected(
            f"set rejected: the images under {earlier} and {later} are the same in "
            f"{equal} of {images.images.shape[1]} rows: the camera repeats frames or "
            "parts of them; check its cable, or use another camera"
        )


def known_levels(checks: ChecksRecord | None) -> tuple[float, ...] | None:
    """LED levels that the redundancy of the images shows; None if it does not show them."""
    if checks is None or checks.light_levels_error is None:
        return None
    is_known = checks.light_levels_error <= acceptance.MAX_LED_LEVEL_ERROR
    return checks.light_levels if is_known else None


def measured_levels(checks: ChecksRecord) -> tuple[float, ...] | None:
    """LED levels by which the light images must be corrected; None if they need no correction."""
    levels, limit = known_levels(checks), acceptance.MAX_LED_LEVEL_DIFFERENCE
    return levels if any(abs(level - 1.0) > limit for level in levels or ()) else None


def _weak_leds(
    agreement: LightAgreement | None, images: CheckedImages, least_level: float | None
) -> tuple[str, ...]:
    """Describe LEDs whose level must be corrected; reject levels out of range or uncertain."""
    if agreement is None or agreement.levels is None:
        return ()
    limit = acceptance.led_level_limit(agreement.level_error)
    unequal_levels = {
        light: level for light, level in enumerate(agreement.levels) if abs(level - 1.0) > limit
    }
    if not unequal_levels:
        return ()
    shares_while_off = share_while_off(images.images, images.ambient)
    causes = tuple(
        f"{images.names[light]} gives {level:.0%} of the others' light"
        + (", and some of it with all LEDs off: it stays on" if shares_while_off[light] > 0 else "")
        for light, level in unequal_levels.items()
    )
    is_known = agreement.level_error <= acceptance.MAX_LED_LEVEL_ERROR
    is_in_range = least_level is not None and all(
        least_level <= level <= 1.0 / least_level for level in unequal_levels.values()
    )
    if is_in_range and is_known:
        return causes
    raise SetRejected(
        "set rejected: "
        + "; ".join(causes)
        + f" (a difference of {limit:.0%} is allowed): an LED is weak, flickers or stays on, the "
        "exposure drifts, or frames show two lights; if the LEDs differ by make, run ps4rig "
        "calibrate plate, or set lights.intensities to what ps4rig rig doctor reports"
    )


def share_while_off(images: npt.NDArray[np.uint16], ambient: npt.NDArray[np.uint16]) -> Floats:
    """Return the share of each LED's light in the ambient image, estimated from the shading.

    Other light from the side of the LED is not told apart, because its shading is the same.
    """
    step = max(1, min(ambient.shape) // _SHADED_PX)
    dark = ambient[::step, ::step].astype(np.float64)
    shading = images[:, ::step, ::step] - dark
    common = shading.mean(axis=0)
    means = shading.mean(axis=(1, 2), keepdims=True)
    distinct_shading = (shading - common * (means / common.mean())).reshape(len(images), -1)
    centred = (dark - dark.mean()).ravel()
    products, squares = distinct_shading @ centred, (distinct_shading**2).sum(axis=1) + 1e-9
    correlations = products / np.sqrt(squares * ((centred**2).sum() + 1e-9))
    return np.where(correlations > _STAYS_ON_CORRELATION, products / squares, 0.0)
