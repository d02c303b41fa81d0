"""`CheckedImages` of a captured or imported set; the checks of photographs.

The limits of a capture do not apply to photographs, which have gloss, cast shadows and near lights.
Only findings that no surface explains lead to a refusal; the others are warnings.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import cv2
import numpy as np

from capture.base.errors import ImportCause
from classify import Calibration, InputError, Lighting, SensorNoise
from classify.base.arrays import Array, BoolArray, Floats
from classify.images import ImageStack
from classify.lights.agreement import LightAgreement, light_agreement
from classify.lights.algebra import drop_one_constants
from classify.lights.led_levels import LEVEL_SAMPLES, LitSamples, levels_of_many
from classify.lights.shading import (
    ShadingOrder,
    explained_detail,
    shading_of,
    shading_order,
    shift_of_one_image,
    unlike_images_of_one_light,
)
from rig import acceptance

from .metadata import ChecksRecord

# Number of columns that are compared before whole rows are.
_PROBED_COLUMNS = 8


@dataclass(frozen=True, eq=False)
class CheckedImages:
    """The images of one set, in the order of the lights, uint16 or `calibrated` float32."""

    images: Array
    ambient: Array
    later_ambient: Array | None  # captured between the lights
    lighting: Lighting
    names: Sequence[str]
    full_scale: float
    noise: SensorNoise | None

    @cached_property
    def ambient_mean(self) -> float:
        return _mean(self.ambient)

    @cached_property
    def signals(self) -> Floats:
        """(N,) mean of each light image above the ambient one."""
        return np.array([_mean(image) for image in self.images]) - self.ambient_mean

    def calibrated(self, calibration: Calibration) -> CheckedImages:
        """Return the images that lights of equal strength all over the frame would give."""
        stack = calibration.corrected(ImageStack(self.images, self.ambient), self.full_scale)
        lighting, full_scale = calibration.lighting_of(self.lighting), self.full_scale
        noise = calibration.noise_of(self.noise, has_ambient=True)
        if calibration.flat_field is not None:
            divisor = calibration.flat_field.without_cosines(lighting)
            stack = divisor.divide(stack, full_scale)
            full_scale = float(divisor.saturation(full_scale))
            lighting = replace(lighting, intensities=np.ones(len(lighting)))
            noise = None  # it is no longer uniform over the frame: estimated from the images
        assert stack.ambient is not None
        return replace(
            self,
            images=stack.images,
            ambient=stack.ambient,
            later_ambient=None,
            lighting=lighting,
            full_scale=full_scale,
            noise=noise,
        )

    def saturated_shares(self) -> list[float]:
        """Share of saturated pixels in each light image."""
        return [np.count_nonzero(image >= self.full_scale) / image.size for image in self.images]

    def agreement(self) -> LightAgreement | None:
        """Agreement of the images; None without four lights in general position."""
        try:
            return light_agreement(
                self.images, self.lighting, self.ambient, self.full_scale, self.noise
            )
        except InputError:  # not four lights, or three of them in one plane
            return None

    def equal_rows(self) -> Iterator[tuple[str, str, int, int]]:
        """Pairs of images with their numbers of equal and of comparable rows."""
        step = max(1, self.images.shape[2] // _PROBED_COLUMNS)
        pairs = zip((*self.names, "ambient light"), (*self.images, self.ambient), strict=True)
        for (first, a), (second, b) in combinations(pairs, 2):
            rows = np.flatnonzero((a[:, ::step] == b[:, ::step]).all(axis=1))
            is_equal = (a[rows] == b[rows]).all(axis=1) & (np.ptp(b[rows], axis=1) > 1)
            if is_equal.any():
                comparable = int(np.count_nonzero(np.ptp(b, axis=1) > 1))
                yield first, second, int(np.count_nonzero(is_equal)), comparable


def _mean(image: Array) -> float:
    """``image.mean()``, in an eighth of its time."""
    return cv2.sumElems(image)[0] / image.size


# Share of equal rows above which two images are the same; some rows may be equal by chance.
_SAME_IMAGE = 0.5
# With this many well exposed images, mostly saturated ones are only a warning.
# test_photograph_checks.py fails with 2 and with 8.
_ENOUGH_IMAGES = 4
_MAX_NAMES = 3  # in one message
# Ratio of the frequencies of the two largest values of an image above which its light is clipped.
# Unclipped values become rarer towards the largest.
_CLIPPED = 4.0
# An image is the raw one of a colour camera (Bayer pattern) if the means of its pixels in even and
# odd rows and columns differ by more. Photographs of 128 px in tests/data reach 0.014.
_MOSAIC = 0.1


@dataclass(frozen=True)
class _Finding:
    """The result of a check; `refutes` if no surface under these lights explains it."""

    cause: ImportCause
    text: str
    refutes: bool


def check_photographs(
    images: CheckedImages, mask: BoolArray | None, calibration: Calibration
) -> tuple[list[_Finding], ChecksRecord]:
    """Check photographs inside `mask` (H, W); four lights are compared after the calibration."""
    shading = shading_of(images.images, images.ambient, images.full_scale, mask)
    order = shading_order(shading, images.lighting)
    calibrated = images.calibrated(calibration)
    agreement = calibrated.agreement()
    findings = [
        *_equal(images),
        *_levels(images, mask),
        *_clipping(images, mask),
        *_mosaic(images),
        *_detail(images, explained_detail(shading)),
        *_registration(images, mask),
        *_order(images, order),
        *_one_light(images, unlike_images_of_one_light(shading, images.lighting)),
        *_four_lights(images, agreement),
        *_many_lights(calibrated),
    ]
    is_confirmed = order.verdict == "confirmed"
    return findings, ChecksRecord.of(agreement, "confirmed" if is_confirmed else "undecided")


def _equal(images: CheckedImages) -> Iterator[_Finding]:
    for first, second, equal, comparable in images.equal_rows():
        if equal > _SAME_IMAGE * comparable:
            text = f"{first} and {second} are the same image in {equal} of {comparable} rows"
            yield _Finding(ImportCause.EQUAL_IMAGES, text, refutes=True)


def _levels(images: CheckedImages, mask: BoolArray | None) -> Iterator[_Finding]:
    inside = np.ones(images.ambient.shape, np.bool_) if mask is None else mask
    ambient = float(images.ambient[inside].mean())
    if ambient > acceptance.MAX_AMBIENT_SHARE * images.full_scale:
        share = ambient / images.full_scale
        yield _Finding(
            ImportCause.SATURATION, f"ambient light fills {share:.0%} of the range", False
        )
    shares = {
        name: float(np.mean(image[inside] >= images.full_scale))
        for name, image in zip(images.names, images.images, strict=True)
    }
    saturated = {
        name: share for name, share in shares.items() if share > acceptance.MAX_SATURATED_SHARE
    }
    if saturated:
        text = (
            f"{_listed(saturated)}: up to {max(saturated.values()):.1%} of the pixels are "
            f"saturated at {images.full_scale}"
        )
        limit = acceptance.MAX_SATURATED_SHARE_OF_PHOTOGRAPH
        unusable_count = sum(share > limit for share in saturated.values())
        refutes = unusable_count > 0 and len(shares) - unusable_count < _ENOUGH_IMAGES
        yield _Finding(ImportCause.SATURATION, text, refutes)
    signals = {
        name: float(image[inside].mean()) - ambient
        for name, image in zip(images.names, images.images, strict=True)
    }
    brightest = max(0.0, *signals.values())
    dark = {
        name: signal
        for name, signal in signals.items()
        if signal <= acceptance.DEAD_LED_SHARE * brightest
    }
    if dark:
        lowest_share = max(0.0, min(dark.values())) / max(brightest, 1e-9)
        text = f"{_listed(dark)}: down to {lowest_share:.1%} of the light of the brightest image"
        yield _Finding(
            ImportCause.DARK, text, min(dark.values()) <= acceptance.MIN_SIGNAL_SHARE * brightest
        )


def _clipping(images: CheckedImages, mask: BoolArray | None) -> Iterator[_Finding]:
    clipped = {
        name: value / images.full_scale
        for name, image in zip(images.names, images.images, strict=True)
        if (value := _clipping_value(image if mask is None else image[mask])) < images.full_scale
    }
    if clipped:
        text = (
            f"{_listed(clipped)}: the light is clipped below full scale, at "
            f"{min(clipped.values()):.0%} of it, so that saturated pixels count as good; shorten "
            "the exposure, and do not scale the values"
        )
        yield _Finding(ImportCause.SATURATION, text, False)


def _clipping_value(pixels: Array) -> float:
    """Value at which pixels are clipped; infinite if they are not."""
    largest = int(pixels.max())
    count = np.count_nonzero(pixels == largest)
    if count <= acceptance.MAX_SATURATED_SHARE * pixels.size:
        return math.inf
    others = pixels[pixels < largest]
    next_count = np.count_nonzero(others == others.max()) if others.size else count
    return largest if count > _CLIPPED * next_count else math.inf


def _listed(names: Collection[str]) -> str:
    first = ", ".join([*names][:_MAX_NAMES])
    return first if len(names) <= _MAX_NAMES else f"{first} and {len(names) - _MAX_NAMES} more"


def _mosaic(images: CheckedImages) -> Iterator[_Finding]:
    """Warn of raw images of a colour camera, in which neighbours see different colours."""
    brightest = images.images[int(images.signals.argmax())]
    cells = [brightest[row::2, column::2] for row in (0, 1) for column in (0, 1)]
    means = [_mean(cell) for cell in cells if cell.size]
    if min(means) < (1.0 - _MOSAIC) * max(means):
        difference = 1.0 - min(means) / max(means)
        text = (
            f"neighbouring pixels differ by {difference:.0%}, as in the raw image of a colour "
            "camera; give images in colour, or the raw ones as DNG"
        )
        yield _Finding(ImportCause.RESIDUAL, text, False)


def _detail(images: CheckedImages, explained: Floats) -> Iterator[_Finding]:
    if len(images.images) < 4:  # three images of a matt surface are linearly independent
        return
    for name, share in zip(images.names, explained.tolist(), strict=False):
        if share < acceptance.LITTLE_EXPLAINED_DETAIL:
            text = (
                f"{name}: the other photographs explain {share:.0%} of its detail: it shows "
                "another scene, or the part or the camera moved"
            )
            yield _Finding(ImportCause.RESIDUAL, text, share < acceptance.MIN_EXPLAINED_DETAIL)


def _registration(images: CheckedImages, mask: BoolArray | None) -> Iterator[_Finding]:
    shift_px = shift_of_one_image(
        images.images, images.ambient, images.lighting, images.full_scale, mask
    )
    if shift_px is not None:
        text = (
            f"a photograph is shifted by about {shift_px:.0f} px against the others: the camera or "
            "the part moved, or crops differ"
        )
        yield _Finding(ImportCause.RESIDUAL, text, False)


def _order(images: CheckedImages, order: ShadingOrder) -> Iterator[_Finding]:
    if order.better is None:
        return
    tilts_deg, names = images.lighting.tilts_deg, images.names
    if isinstance(order.better, str):
        text = f"the shading fits the lights with {order.better}; x is to the right and y up"
    elif len(names) <= 4:
        best = ", ".join(f"{tilt:g}" for tilt in np.round(tilts_deg[list(order.better)], 1))
        text = (
            f"by their shading the photographs were taken under tilts {best}, or all of these "
            "rotated by 180 degrees; give images and lights in the same order"
        )
    else:
        misplaced = [k for k, light in enumerate(order.better) if k != light]
        image, light = misplaced[0], order.better[misplaced[0]]
        text = f"by its shading {names[image]} was taken under the light of {names[light]}"
        is_swap = len(misplaced) == 2
        text += " and the other way round" if is_swap else ", and others in this order too"
    yield _Finding(ImportCause.LIGHT_ORDER, text, refutes=True)


def _one_light(images: CheckedImages, pairs: Sequence[tuple[int, int]]) -> Iterator[_Finding]:
    for first, second in pairs:
        text = (
            f"{images.names[first]} and {images.names[second]} have one light direction, tilt "
            f"{images.lighting.tilts_deg[first]:.3g} degrees, but another shading"
        )
        yield _Finding(ImportCause.LIGHT_ORDER, text, refutes=True)


def _four_lights(images: CheckedImages, agreement: LightAgreement | None) -> Iterator[_Finding]:
    if len(images.images) == 4 and agreement is None:
        try:
            drop_one_constants(images.lighting, "ps4_robust")
        except InputError as error:
            yield _Finding(
                ImportCause.RESIDUAL, f"{error}; solve with --method least_squares", False
            )
    if agreement is None or agreement.levels is None:
        return
    limit = acceptance.led_level_limit(agreement.level_error)
    for name, level in zip(images.names, agreement.levels, strict=True):
        if abs(level - 1.0) > limit:
            reference = (
                "of the given intensity" if images.lighting.intensities_given else "of the others"
            )
            text = (
                f"{name}: by the redundancy of the images its light gives {level:.0%} {reference}"
            )
            yield _Finding(ImportCause.RESIDUAL, text, False)


def _many_lights(images: CheckedImages) -> Iterator[_Finding]:
    if len(images.images) < 5:
        return
    lighting = images.lighting
    gains = (1.0 / lighting.intensities).astype(np.float32)
    samples = ImageStack(images.images, images.ambient).sample(LEVEL_SAMPLES, gains)
    levels = levels_of_many(LitSamples.of(*samples, images.full_scale).values, lighting)
    if levels is None or np.abs(levels - 1.0).max() <= acceptance.MAX_LED_LEVEL_DIFFERENCE:
        return
    intensities = levels * lighting.intensities
    listed = ", ".join(f"{intensity:.3f}" for intensity in intensities / np.median(intensities))
    text = f"by their redundancy the images fit lights of the intensities {listed}"
    yield _Finding(ImportCause.RESIDUAL, f"{text}; --lights can state them", False)
