"""What one picture under each LED tells of the LEDs, of the exposure and of the LEDs' order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

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

__all__ = ["Pictures", "check_pictures", "take_pictures"]

# The brightest pixels but for a few glints are brought to this share of full scale.
_BRIGHT_PERCENTILE, _TARGET = 99.9, 0.8
_GOOD_EXPOSURE = (0.4, 0.95)
# Pixels of a part that is exposed at several times the right value are all white.
_SHORTER_WHEN_SATURATED = 0.4


@dataclass(frozen=True, eq=False)
class Pictures:
    """One picture without and one under each LED.

    Parameters
    ----------
    dark
        (H, W), all LEDs out.
    lit
        (N, H, W) of the same type, LED by LED.
    full_scale
        Pixel value of saturation.
    """

    dark: npt.NDArray[np.uint16]
    lit: npt.NDArray[np.uint16]
    full_scale: int


def take_pictures(rig: Rig) -> Pictures:
    """One fresh picture without and under each LED; the LEDs are put out at the end.

    Raises
    ------
    HardwareError
        If the controller or the camera fails, or no good frame comes after a switch.
    """
    try:
        dark, *lit = (
            fresh_frame(rig, led).pixels.astype(np.uint16)
            for led in (None, *range(len(rig.lighting)))
        )
    finally:
        rig.lights.off()
    return Pictures(dark, np.stack(lit), (1 << rig.camera.info.bit_depth) - 1)


def check_pictures(
    pictures: Pictures, lighting: Lighting, exposure_ms: float, longest_ms: float
) -> Iterator[Check]:
    """Ambient light, every LED, saturation, exposure, strengths and order of the LEDs.

    Parameters
    ----------
    pictures
        Of any part with relief.
    lighting
        As configured.
    exposure_ms, longest_ms
        As it was, and the longest that fits into a frame.
    """
    full = pictures.full_scale
    yield _ambient(float(pictures.dark.mean()) / full)
    signals = (
        pictures.lit.mean(axis=(1, 2), dtype=np.float64) - pictures.dark.mean(dtype=np.float64)
    ) / full
    for led, signal in enumerate(signals):
        yield _led(led, float(signal), float(signals.max()))
    yield _saturation(pictures)
    yield _exposure(pictures, exposure_ms, longest_ms)
    yield _strengths(pictures, lighting)
    yield _order(pictures, lighting)


def _ambient(share: float) -> Check:
    seen = f"{share:.1%} of full scale with all LEDs out"
    if share <= HIGH_AMBIENT_SHARE:
        return Check("ambient light", "ok", seen)
    status: Status = "fault" if share > MAX_AMBIENT_SHARE else "warning"
    return Check(
        "ambient light", status, seen, "shield the rig from other light; does an LED stay on?"
    )


def _led(led: int, signal: float, brightest: float) -> Check:
    name = f"LED {led}"
    seen = f"{signal:.1%} of full scale above dark"
    if signal < MIN_SIGNAL_SHARE or signal < DEAD_LED_SHARE * brightest:
        return Check(
            name,
            "fault",
            f"{seen}: dead",
            "check its wiring, its resistor and whether something stands before it",
        )
    seen += f", {signal / brightest:.0%} of the brightest LED"
    if signal < WEAK_LED_SHARE * brightest:
        return Check(name, "warning", f"{seen}: weak", "clean or replace it, or lower the others")
    return Check(name, "ok", seen)


def _saturation(pictures: Pictures) -> Check:
    white = (pictures.lit >= pictures.full_scale).mean(axis=(1, 2))
    seen = f"at most {white.max():.2%} of the pixels are saturated, under LED {white.argmax()}"
    if white.max() > MAX_SATURATED_SHARE:
        return Check("saturation", "fault", seen, "shorten the exposure; see below")
    return Check("saturation", "ok", seen)


def _exposure(pictures: Pictures, exposure_ms: float, longest_ms: float) -> Check:
    """Of the brightest LED: the others are exposed alike, so that they can be compared."""
    full = pictures.full_scale
    bright = np.percentile(pictures.lit, _BRIGHT_PERCENTILE, axis=(1, 2))
    led = int(bright.argmax())
    share = float(bright[led]) / full
    seen = (
        f"{exposure_ms:g} ms; the brightest {1 - _BRIGHT_PERCENTILE / 100:.1%} of the pixels under "
        f"LED {led} are at {share:.0%} of full scale"
    )
    if _GOOD_EXPOSURE[0] <= share <= _GOOD_EXPOSURE[1]:
        return Check("exposure", "ok", seen)
    if bright[led] >= full:
        factor = _SHORTER_WHEN_SATURATED
    else:
        # What is there without any light stays, however long it is collected.
        black = float(pictures.dark.min())
        factor = (_TARGET * full - black) / max(float(bright[led]) - black, 1.0)
    wanted_ms = exposure_ms * factor
    if wanted_ms <= longest_ms:
        advice = f"set camera.exposure_ms = {wanted_ms:.3g}" + (
            " and look again" if bright[led] >= full else ""
        )
    else:
        advice = (
            f"set camera.exposure_ms = {longest_ms:.3g}, the longest at this frame rate; a lower "
            "frame rate, more gain or stronger LEDs would give more"
        )
    return Check("exposure", "warning", seen, advice)


def _strengths(pictures: Pictures, lighting: Lighting) -> Check:
    """How strong the LEDs are against each other, whatever the part turns towards them."""
    name = "LED strengths"
    if len(lighting) != 4:
        return Check(name, "unknown", "are told from the pictures for four LEDs only")
    told = light_agreement(pictures.lit, lighting, pictures.dark, pictures.full_scale, None)
    if told.strengths is None or told.strength_error > MAX_LED_LEVEL_ERROR:
        return Check(
            name,
            "unknown",
            "these pictures do not tell them",
            "lay something matt with relief in all directions below the camera",
        )
    seen = "against the configured " + ", ".join(f"{each:.1%}" for each in told.strengths)
    if all(abs(each - 1.0) <= EQUAL_LED_LEVELS for each in told.strengths):
        return Check(name, "ok", seen)
    line = ", ".join(f"{each:.3f}" for each in lighting.intensities * told.strengths)
    return Check(
        name, "warning", seen, f"if they are so by make, set lights.intensities = [{line}]"
    )


def _order(pictures: Pictures, lighting: Lighting) -> Check:
    name = "LED order"
    if len(lighting) != 4:
        return Check(name, "unknown", "is told from the pictures for four LEDs only")
    told = light_order(
        pictures.lit, lighting, ambient=pictures.dark, full_scale=pictures.full_scale
    )
    turned = "; whether all are turned by 180 degrees no picture can tell"
    if told.is_refuted:
        likely = [
            _exchange(order) for order in sorted(told.plausible, key=_moved)[:2] if _moved(order)
        ]
        return Check(
            name,
            "fault",
            "the shading contradicts lights.tilts_deg: " + " or ".join(likely),
            "exchange their plugs, or correct lights.tilts_deg",
        )
    if told.is_confirmed:
        return Check(name, "ok", "the shading agrees with lights.tilts_deg" + turned)
    return Check(
        name,
        "unknown",
        f"{len(told.plausible)} of 24 orders explain these pictures",
        "lay something with relief in all directions below the camera, such as a coin or a rough "
        "stone",
    )


def _moved(order: Order) -> int:
    return sum(shown != led for led, shown in enumerate(order))


def _exchange(order: Order) -> str:
    moved = [f"where {led} should be is {shown}" for led, shown in enumerate(order) if shown != led]
    if len(moved) == 2:
        one, other = (led for led, shown in enumerate(order) if shown != led)
        return f"LEDs {one} and {other} are exchanged"
    return "LEDs are exchanged (" + ", ".join(moved) + ")"
