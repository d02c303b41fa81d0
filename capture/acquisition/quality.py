"""Reject light images that are saturated or dark."""

from __future__ import annotations

import numpy as np

from capture.errors import SetRejected
from rig.acceptance import DEAD_LED_SHARE, MAX_AMBIENT_SHARE, MAX_SATURATED_SHARE, MIN_SIGNAL_SHARE

from .light_checks import LightImages

__all__ = ["check_images"]


def check_images(images: LightImages) -> None:
    """Reject images that are saturated or dark, by the levels of `rig.acceptance`.

    Raises
    ------
    SetRejected
        Names each such light with its value.
    """
    causes: list[str] = []
    full_scale, ambient_mean = images.full_scale, float(images.ambient.mean())
    if ambient_mean > MAX_AMBIENT_SHARE * full_scale:
        causes.append(
            f"ambient light fills {ambient_mean / full_scale:.0%} of the range; shield the rig"
        )
    signals = images.signals()
    brightest = float(signals.max())
    for name, image, signal in zip(images.names, images.images, signals, strict=True):
        saturated = float(np.count_nonzero(image >= full_scale)) / image.size
        if saturated > MAX_SATURATED_SHARE:
            causes.append(
                f"{name}: {saturated:.1%} of the pixels are saturated (limit "
                f"{MAX_SATURATED_SHARE:.0%}); shorten the exposure"
            )
        elif signal < MIN_SIGNAL_SHARE * full_scale:
            causes.append(
                f"{name}: dark, {signal:.1f} of {full_scale} above ambient light: the LED is dead "
                "or always on, or the exposure too short; run ps4rig rig doctor"
            )
        elif signal < DEAD_LED_SHARE * brightest:
            causes.append(
                f"{name}: only {signal / brightest:.0%} of the brightest light (limit "
                f"{DEAD_LED_SHARE:.0%}); uncover or replace the LED"
            )
    if causes:
        raise SetRejected("set rejected: " + "; ".join(causes))
