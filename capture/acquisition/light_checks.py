"""Whether the pictures of a set show the lights that they are named for.

Each check that cannot decide on a surface says so, and leaves the word to the next: four pictures
of a matt surface vouch for one another; those that do not are taken a second time, in the other
order, and a fault does not come twice alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from capture.errors import SetRejected
from capture.sets.metadata import ChecksRecord
from classify import Lighting
from classify.errors import InputError
from classify.images.noise import SensorNoise
from classify.lights.agreement import LightAgreement, light_agreement, picture_difference
from classify.lights.order import light_order
from rig.acceptance import (
    LED_LEVEL_STANDARD_ERRORS,
    MAX_AMBIENT_CHANGE,
    MAX_LED_LEVEL_DIFFERENCE,
    MAX_LED_LEVEL_ERROR,
    MAX_REDUNDANCY_RESIDUAL,
    MAX_RETAKE_CHANGE,
    MIN_COMPARED_ROWS,
    WEAK_LED_SHARE,
)

__all__ = ["Pictures", "check_ambient", "check_lights"]

Images = npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Pictures:
    """The pictures of one set, in the order of the lights.

    Attributes
    ----------
    images
        (N, H, W).
    ambient, later_ambient
        (H, W) with all lights out, before the lights and between them; the later one may be None.
    full_scale, noise
        Pixel value of saturation; noise of the images, None if it is not known.
    """

    images: Images
    ambient: Images
    later_ambient: Images | None
    full_scale: int
    noise: SensorNoise | None


def check_ambient(pictures: Pictures) -> float | None:
    """How much the two ambient images differ, as a share of the brightest light's image.

    None if there is only one.

    Raises
    ------
    SetRejected
        If they do.
    """
    if pictures.later_ambient is None:
        return None
    means = pictures.images.mean(axis=(1, 2))
    signal = max(1.0, float(means.max()) - float(pictures.ambient.mean()))
    change = picture_difference(pictures.ambient, pictures.later_ambient, signal, pictures.noise)
    if change > MAX_AMBIENT_CHANGE:
        raise SetRejected(
            f"set rejected: with all LEDs off the picture changed by {change:.0%} of an LED's "
            "light while the set was taken: an LED stays on, a frame was black, torn or older than "
            "its time stamp says, or other light came or went"
        )
    return change


def check_lights(
    pictures: Pictures,
    lighting: Lighting,
    names: list[str],
    ambient_change: float | None,
    second_look: Callable[[], Images],
) -> ChecksRecord:
    """Reject pictures of wrong light.

    Parameters
    ----------
    pictures
        Of a set that is neither saturated nor dark.
    lighting
        Its lights.
    names
        What people call them.
    ambient_change
        From `check_ambient`, for the record.
    second_look
        Takes all light images again, in the opposite order; called only where the first ones do
        not vouch for each other.

    Raises
    ------
    SetRejected
        With the cause.
    """
    _refuse_equal(pictures.images, names)
    agreement = _agreement(pictures, lighting)
    if agreement is not None:
        _check_strengths(agreement, pictures, names)
    undecided = _undecided(agreement)
    if undecided:
        _compare(pictures, second_look(), names)
        if agreement is None or agreement.strengths is None:
            _check_shares(pictures, lighting, names)
    return ChecksRecord(
        ambient_change=ambient_change,
        redundancy_residual=None if agreement is None else agreement.contradiction,
        light_levels=None if agreement is None else agreement.strengths,
        light_levels_error=None
        if agreement is None or agreement.strengths is None
        else agreement.strength_error,
        retaken=bool(undecided),
        light_order=_checked_order(pictures, lighting),
        undecided=undecided,
    )


def _agreement(pictures: Pictures, lighting: Lighting) -> LightAgreement | None:
    try:
        return light_agreement(
            pictures.images, lighting, pictures.ambient, pictures.full_scale, pictures.noise
        )
    except InputError:
        return None  # not four lights, or three of them in one plane


def _refuse_equal(images: Images, names: list[str]) -> None:
    """Noise never falls twice alike: a row that is in two pictures is of one frame."""
    for later in range(1, len(images)):
        varied = np.ptp(images[later], axis=1) > 1
        for earlier in range(later):
            same = varied & (images[earlier] == images[later]).all(axis=1)
            if same.any():
                raise SetRejected(
                    f"set rejected: the pictures under {names[earlier]} and {names[later]} are the "
                    f"same, pixel by pixel, in {np.count_nonzero(same)} of {len(same)} rows; the "
                    "camera repeats frames or parts of them"
                )


def _check_strengths(agreement: LightAgreement, pictures: Pictures, names: list[str]) -> None:
    if agreement.strengths is None:
        return
    room = max(MAX_LED_LEVEL_DIFFERENCE, LED_LEVEL_STANDARD_ERRORS * agreement.strength_error)
    causes = [
        f"{name} gives {strength:.0%} of the others' light{_hint(pictures, light)}"
        for light, (name, strength) in enumerate(zip(names, agreement.strengths, strict=True))
        if abs(strength - 1.0) > room
    ]
    if causes:
        raise SetRejected(
            "set rejected: "
            + "; ".join(causes)
            + f" (limit {room:.0%}): an LED is weak, flickers or stays on, the exposure drifts, or "
            "frames show two lights; for LEDs that are so by make, ps4rig rig doctor tells "
            "lights.intensities"
        )


def _hint(pictures: Pictures, light: int) -> str:
    """Whether the light of an LED is there when it should be off."""
    dark = pictures.ambient.astype(np.float64)
    shading = pictures.images - dark
    common = shading.mean(axis=0)
    own = shading[light] - common * (shading[light].mean() / common.mean())
    lit = dark - dark.mean()
    alike = float((own * lit).sum() / np.sqrt((own**2).sum() * (lit**2).sum() + 1e-9))
    return ", and there is some with all LEDs off: it stays on" if alike > 0.3 else ""


def _undecided(agreement: LightAgreement | None) -> tuple[str, ...]:
    """What the four pictures cannot vouch for."""
    if agreement is None:
        return ("four lights in general position would vouch for each other",)
    causes = []
    if agreement.contradiction > MAX_REDUNDANCY_RESIDUAL:
        causes.append(f"the pictures contradict each other by {agreement.contradiction:.1%}")
    if agreement.seen < MIN_COMPARED_ROWS:
        causes.append(f"all lights together reach {agreement.seen:.0%} of the rows")
    if agreement.strengths is None:
        causes.append("no strengths of the lights explain the pictures")
    elif agreement.strength_error > MAX_LED_LEVEL_ERROR:
        causes.append(f"strengths of the lights are known to {agreement.strength_error:.1%} only")
    return tuple(causes)


def _compare(pictures: Pictures, again: Images, names: list[str]) -> None:
    dark = float(pictures.ambient.mean())
    for name, first, second in zip(names, pictures.images, again, strict=True):
        signal = float(first.mean()) - dark
        change = picture_difference(first, second, signal, pictures.noise)
        change = max(change, abs(float(second.mean()) - dark - signal) / signal)
        if change > MAX_RETAKE_CHANGE:
            raise SetRejected(
                f"set rejected: under {name} two pictures differ by {change:.0%}: the LED "
                "flickers, the exposure drifts, a frame was torn or showed another light, or the "
                "part moved"
            )


def _check_shares(pictures: Pictures, lighting: Lighting, names: list[str]) -> None:
    signals = pictures.images.mean(axis=(1, 2)) - float(pictures.ambient.mean())
    signals /= lighting.intensities
    median = float(np.median(signals))
    for name, signal in zip(names, signals, strict=True):
        if signal < WEAK_LED_SHARE * median:
            raise SetRejected(
                f"set rejected: {name} gives {signal / median:.0%} of the light of the others; is "
                "the LED weak or covered, or the part in its shadow?"
            )


def _checked_order(pictures: Pictures, lighting: Lighting) -> Literal["confirmed", "undecided"]:
    if len(lighting) != 4:
        return "undecided"
    order = light_order(
        pictures.images, lighting, ambient=pictures.ambient, full_scale=pictures.full_scale
    )
    # Which of the two ways round the ring stands is left to the smallest of its errors.
    if order.is_refuted and order.opposite not in order.plausible:
        best = ", ".join(f"{tilt:g}" for tilt in lighting.tilts_deg[list(order.plausible[0])])
        raise SetRejected(
            "set rejected: the LEDs are not in the order of lights.tilts_deg; by their shading "
            f"the pictures were taken under tilts {best}: are cables exchanged, or is an LED dead?"
        )
    return "confirmed" if order.is_confirmed else "undecided"
