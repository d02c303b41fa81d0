"""Checks of one light image per LED: LEDs, exposure, saturation, levels and order."""

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import ROUND_FLOOR, Context

import numpy as np
import numpy.typing as npt

from classify import Lighting
from classify.lights.agreement import light_agreement
from classify.lights.order import Order, light_order
from rig.acceptance import (
    DEAD_LED_SHARE,
    EQUAL_LED_LEVELS,
    HIGH_AMBIENT_SHARE,
    MAX_AMBIENT_SHARE,
    MAX_LED_LEVEL_ERROR,
    MAX_SATURATED_SHARE,
    MIN_SIGNAL_SHARE,
    WEAK_LED_SHARE,
)
from rig.fresh_frame import fresh_frame
from rig.rig import Rig

from .check import Check, Status

# Percentile of the pixels that rates the exposure, so that a few glints do not count.
_BRIGHT_PERCENTILE = 99.9
# Share of full scale to which the proposed exposure brings that percentile. It leaves room for a
# part that is a quarter brighter.
_TARGET_SHARE = 0.8
# Shares of full scale between which an exposure needs no change.
_GOOD_EXPOSURE = (0.4, 0.95)
# The factor for a saturated image, whose excess is unknown. Applied twice, it corrects an exposure
# that is six times too long.
_SHORTER_WHEN_SATURATED = 0.4


@dataclass(frozen=True, eq=False)
class LightImages:
    """One ambient image, and one image under each LED."""

    ambient: npt.NDArray[np.uint16]  # (H, W)
    lights: npt.NDArray[np.uint16]  # (N, H, W), in the order of the LEDs
    full_scale: int  # pixel value of saturation


def capture_light_images(rig: Rig) -> LightImages:
    """Capture an ambient image and one image under each LED; put the LEDs out at the end."""
    try:
        ambient, *lights = (
            fresh_frame(rig, led).pixels.astype(np.uint16)
            for led in (None, *range(len(rig.lighting)))
        )
    finally:
        rig.lights.off()
    return LightImages(ambient, np.stack(lights), (1 << rig.camera.info.bit_depth) - 1)


def check_light_images(
    images: LightImages, lighting: Lighting, exposure_ms: float, range_ms: tuple[float, float]
) -> Iterator[Check]:
    """Check ambient light, every LED, saturation, exposure, levels and order of the LEDs."""
    yield from check_leds(images)
    yield _saturation(images)
    yield _exposure(images, exposure_ms, range_ms)
    yield _levels(images, lighting)
    yield _order(images, lighting)


def check_leds(images: LightImages) -> Iterator[Check]:
    """Check ambient light and every LED; any part may be below the camera."""
    full = images.full_scale
    yield _ambient(float(images.ambient.mean()) / full)
    lit = images.lights.mean(axis=(1, 2), dtype=np.float64)
    signals = (lit - images.ambient.mean(dtype=np.float64)) / full
    for led, signal in enumerate(signals):
        yield _led(led, float(signal), float(signals.max()))


def _ambient(share: float) -> Check:
    finding = f"{share:.1%} of full scale with all LEDs off"
    if share <= HIGH_AMBIENT_SHARE:
        return Check("ambient light", "ok", finding, device="lights")
    status: Status = "fault" if share > MAX_AMBIENT_SHARE else "warning"
    advice = "shield the rig from other light; does an LED stay on?"
    return Check("ambient light", status, finding, advice, "lights")


def _led(led: int, signal: float, brightest: float) -> Check:
    name = f"LED {led}"
    finding = f"{signal:.1%} of full scale above dark"
    if signal < MIN_SIGNAL_SHARE or signal < DEAD_LED_SHARE * brightest:
        advice = "check its wiring, its resistor and whether something blocks its light"
        return Check(name, "fault", f"{finding}: dead", advice, "lights")
    finding += f", {signal / brightest:.0%} of the brightest LED"
    if signal < WEAK_LED_SHARE * brightest:
        advice = "clean or replace it, or lower the others"
        return Check(name, "warning", f"{finding}: weak", advice, "lights")
    return Check(name, "ok", finding, device="lights")


def _saturation(images: LightImages) -> Check:
    saturated = (images.lights >= images.full_scale).mean(axis=(1, 2))
    finding = "no pixel is saturated under any LED"
    if saturated.any():
        finding = (
            f"LED {saturated.argmax()} saturates {saturated.max():.2%} of the pixels, the others "
            "fewer"
        )
    if saturated.max() > MAX_SATURATED_SHARE:
        return Check("saturation", "fault", finding, "shorten the exposure; see below")
    return Check("saturation", "ok", finding)


@dataclass(frozen=True)
class _ExposureRating:
    """Rating of an exposure by the brightest LED, because all images share one exposure."""

    led: int
    share: float  # of full scale, of its bright pixels
    factor: float  # for the exposure; for a saturated image a first guess

    @property
    def is_good(self) -> bool:
        """Whether the exposure can stay as it is."""
        return _GOOD_EXPOSURE[0] <= self.share <= _GOOD_EXPOSURE[1]

    @property
    def is_saturated(self) -> bool:
        """Whether the bright pixels are at full scale."""
        return self.share >= 1.0


def rate_exposure(images: LightImages) -> _ExposureRating:
    """Rate the exposure of light images."""
    full = images.full_scale
    bright = np.percentile(images.lights, _BRIGHT_PERCENTILE, axis=(1, 2))
    led = int(bright.argmax())
    if bright[led] >= full:
        return _ExposureRating(led, 1.0, _SHORTER_WHEN_SATURATED)
    # The black level does not grow with the exposure.
    black = float(images.ambient.min())
    factor = (_TARGET_SHARE * full - black) / max(float(bright[led]) - black, 1.0)
    return _ExposureRating(led, float(bright[led]) / full, factor)


def _exposure(images: LightImages, exposure_ms: float, range_ms: tuple[float, float]) -> Check:
    rating = rate_exposure(images)
    finding = (
        f"{exposure_ms:g} ms; the brightest {1 - _BRIGHT_PERCENTILE / 100:.1%} of the pixels under "
        f"LED {rating.led} are at {rating.share:.0%} of full scale"
    )
    if rating.is_good:
        return Check("exposure", "ok", finding)
    proposed_ms, (shortest_ms, longest_ms) = exposure_ms * rating.factor, range_ms
    if shortest_ms == longest_ms:
        change = "dim the LEDs, or close" if rating.factor < 1.0 else "brighter LEDs, or open"
        advice = f"the exposure is fixed: {change} the aperture"
    elif proposed_ms <= longest_ms:
        advice = f"set camera.exposure_ms = {_rounded_down(proposed_ms):g}"
        if rating.is_saturated:
            advice += ", then run this again"
    else:
        advice = (
            f"set camera.exposure_ms = {_rounded_down(longest_ms):g}, the longest at this frame "
            "rate; a lower frame rate, more gain or brighter LEDs would help"
        )
    return Check("exposure", "warning", finding, advice)


def _rounded_down(exposure_ms: float) -> float:
    """Three digits of an exposure, rounded down so that it fits into a frame."""
    return float(Context(prec=3, rounding=ROUND_FLOOR).create_decimal_from_float(exposure_ms))


def _levels(images: LightImages, lighting: Lighting) -> Check:
    """Compare levels that are estimated from four images, independently of the part."""
    name = "LED levels"
    if len(lighting) != 4:
        return Check(name, "unknown", "can be estimated for four LEDs only")
    agreement = light_agreement(images.lights, lighting, images.ambient, images.full_scale, None)
    if agreement.levels is None or agreement.level_error > MAX_LED_LEVEL_ERROR:
        advice = "put something matt with relief in all directions below the camera"
        return Check(name, "unknown", "cannot be estimated from these images", advice)
    finding = "relative to the configured " + ", ".join(
        f"{level:.1%}" for level in agreement.levels
    )
    if all(abs(level - 1.0) <= EQUAL_LED_LEVELS for level in agreement.levels):
        return Check(name, "ok", finding)
    line = ", ".join(f"{level:.3f}" for level in lighting.intensities * agreement.levels)
    advice = f"if the LEDs are built with these levels, set lights.intensities = [{line}]"
    return Check(name, "warning", finding, advice)


def _order(images: LightImages, lighting: Lighting) -> Check:
    name = "LED order"
    if len(lighting) != 4:
        return Check(name, "unknown", "can be checked for four LEDs only")
    order = light_order(
        images.lights, lighting, ambient=images.ambient, full_scale=images.full_scale
    )
    if order.is_refuted:
        likely_orders = sorted(order.plausible, key=lambda other: len(_moved(other)))[:2]
        likely = " or ".join(_exchange(other) for other in likely_orders if _moved(other))
        finding = f"the shading contradicts lights.tilts_deg: {likely}"
        return Check(name, "fault", finding, "exchange their plugs, or correct lights.tilts_deg")
    if order.is_confirmed:
        finding = "the shading agrees with lights.tilts_deg; a rotation of all LEDs by 180 degrees "
        return Check(name, "ok", finding + "does not show in images")
    finding = f"{len(order.plausible)} of 24 orders explain these images"
    advice = "put a coin or a rough stone below the camera, with relief in all directions"
    return Check(name, "unknown", finding, advice)


def _moved(order: Order) -> list[int]:
    """LEDs that are not at their own place in `order`."""
    return [led for led, other in enumerate(order) if other != led]


def _exchange(order: Order) -> str:
    moved = _moved(order)
    if len(moved) == 2:
        return f"LEDs {moved[0]} and {moved[1]} are exchanged"
    places = ", ".join(f"{order[led]} is where {led} should be" for led in moved)
    return f"LEDs are exchanged ({places})"
