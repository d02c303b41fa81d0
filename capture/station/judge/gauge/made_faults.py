"""Faults that nobody configured, made from the images of good parts."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from capture.sets.captured_set import CapturedSet

_Images = npt.NDArray[np.float32]
_Unit = Literal["of the frame", "of the taught value"]

# Shares of the frame's shorter side; the last one is the size that every recipe must find.
_SIZES = (0.06, 0.1, 0.2)
_CONTRAST = 0.3  # of a stain
_DEPTH_PER_SIZE = 0.1  # of a dent
_EDGE_PX = 3.0  # width of the soft edge of a piece
_SAME_TILT_DEG = 3.0  # largest difference of the tilts of lights that replace each other


@dataclass(frozen=True)
class Place:
    """Middle of a fault in px from the middle of the frame, and the direction of a strip."""

    x_px: float
    y_px: float
    angle_deg: float


@dataclass(frozen=True)
class MadeFault:
    """A kind of fault with three strengths, made from images without ambient light."""

    name: str
    unit: _Unit  # of a strength: size of the fault, or factor of the whole part
    strengths: tuple[float, float, float]
    # From images, tilts of lights in deg, strength, place; None where the lights forbid it.
    make: Callable[[_Images, npt.NDArray[np.float64], float, Place], _Images | None]
    needs_handedness: bool = False  # cannot be seen on a texture that looks like its mirror image
    needs_direction: bool = False  # need not be seen on a texture that looks alike at 90 degrees

    @property
    def is_local(self) -> bool:
        """Whether it covers a piece of the part."""
        return self.unit == "of the frame"


def with_fault(
    captured: CapturedSet, fault: MadeFault, strength: float, place: Place
) -> CapturedSet | None:
    """The set of a good part with a fault; None where its lights do not allow it."""
    dark = 0.0 if captured.ambient is None else captured.ambient.astype(np.float32)
    signals = captured.images.astype(np.float32) - dark
    changed = fault.make(signals, captured.lighting.tilts_deg, strength, place)
    if changed is None:
        return None
    values = np.clip(np.rint(changed + dark), 0.0, captured.metadata.full_scale)
    return replace(captured, images=values.astype(np.uint16))


def _from_middle(images: _Images, place: Place) -> tuple[_Images, _Images]:
    rows, columns = images.shape[1:]
    x = np.arange(columns, dtype=np.float32) - np.float32(0.5 * (columns - 1) + place.x_px)
    y = np.float32(0.5 * (rows - 1) - place.y_px) - np.arange(rows, dtype=np.float32)
    return x, y[:, None]


def _side_px(images: _Images) -> int:
    return int(min(images.shape[1:]))


def _disc(images: _Images, size: float, place: Place) -> _Images:
    """Weight of a round piece, with a soft edge."""
    x, y = _from_middle(images, place)
    inside = np.float32(0.5 * size * _side_px(images)) - np.hypot(x, y)
    return np.asarray(np.clip(inside / np.float32(_EDGE_PX) + 0.5, 0.0, 1.0), np.float32)


def _blended(images: _Images, other: _Images, weight: _Images) -> _Images:
    return np.asarray(images + weight * (other - images), np.float32)


def _smooth(images: _Images, sigma_px: float) -> _Images:
    return np.stack([cv2.GaussianBlur(image, (0, 0), sigma_px) for image in images])


def _hole(images: _Images, _: Any, size: float, place: Place) -> _Images:
    weight = _disc(images, size, place)
    means = (images * weight).sum(axis=(1, 2)) / weight.sum()
    return _blended(images, np.broadcast_to(means[:, None, None], images.shape), weight)


def _strip(images: _Images, _: Any, size: float, place: Place) -> _Images:
    x, y = _from_middle(images, place)
    angle = math.radians(place.angle_deg)
    across = np.abs(np.float32(math.cos(angle)) * x + np.float32(math.sin(angle)) * y)
    inside = np.float32(0.5 * size * _side_px(images)) - across
    weight = np.clip(inside / np.float32(_EDGE_PX) + 0.5, 0.0, 1.0).astype(np.float32)
    return _blended(images, _smooth(images, 8.0), weight)


def _stain(images: _Images, _: Any, size: float, place: Place) -> _Images:
    return _blended(images, images * np.float32(1.0 - _CONTRAST), _disc(images, size, place))


def _dent(images: _Images, tilts_deg: Any, size: float, place: Place) -> _Images:
    """Slopes of a raised cosine, added to the shading at a slant of 45 degrees."""
    x, y = _from_middle(images, place)
    radius = 0.5 * size * _side_px(images)
    phase = np.pi * np.minimum(np.hypot(x, y) / radius, 1.0)
    depth = _DEPTH_PER_SIZE * 2.0 * radius
    slope = 0.5 * depth * (np.pi / radius) ** 2 * np.sinc(phase / np.pi)
    tilts = np.radians(tilts_deg)[:, None, None]
    towards = np.cos(tilts) * (slope * x) + np.sin(tilts) * (slope * y)
    return np.asarray(images - towards * images.mean(axis=0), np.float32)


def _rotated(images: _Images, tilts_deg: Any, size: float, place: Place) -> _Images | None:
    lights = _lights(tilts_deg, lambda tilt_deg: tilt_deg - 90.0)
    if lights is None:
        return None
    side = _side_px(images)
    square = images[:, :side, :side]
    other = images.copy()
    other[:, :side, :side] = np.rot90(square, axes=(1, 2))[lights]
    return _blended(images, other, _disc(images, size, place))


def _mirrored(images: _Images, tilts_deg: Any, size: float, place: Place) -> _Images | None:
    lights = _lights(tilts_deg, lambda tilt_deg: 180.0 - tilt_deg)
    if lights is None:
        return None
    other = images[:, :, ::-1][lights]
    return other if size >= 1.0 else _blended(images, other, _disc(images, size, place))


def _lights(tilts_deg: Any, source_deg: Callable[[float], float]) -> list[int] | None:
    """For each light, the one whose light came from `source_deg` of its tilt; None without one."""
    lights = []
    for tilt_deg in tilts_deg.tolist():
        differences_deg = np.abs((tilts_deg - source_deg(tilt_deg) + 180.0) % 360.0 - 180.0)
        if differences_deg.min() > _SAME_TILT_DEG:
            return None
        lights.append(int(differences_deg.argmin()))
    return lights


def _scaled(images: _Images, _: Any, factor: float, __: Place) -> _Images:
    rows, columns = images.shape[1:]
    matrix = cv2.getRotationMatrix2D((0.5 * (columns - 1), 0.5 * (rows - 1)), 0.0, factor)
    return np.stack([
        cv2.warpAffine(
            image, matrix, (columns, rows), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
        )
        for image in images
    ])  # fmt: skip


def _darker(images: _Images, _: Any, factor: float, __: Place) -> _Images:
    return images * np.float32(factor)


def _deeper(images: _Images, _: Any, factor: float, __: Place) -> _Images:
    mean = images.mean(axis=0)
    return np.asarray(mean + np.float32(factor) * (images - mean), np.float32)


FAULTS: tuple[MadeFault, ...] = (
    MadeFault("hole", "of the frame", _SIZES, _hole),
    MadeFault("worn strip", "of the frame", _SIZES, _strip),
    MadeFault("stain of 30 %", "of the frame", _SIZES, _stain),
    MadeFault("dent", "of the frame", _SIZES, _dent),
    MadeFault("rotated piece", "of the frame", _SIZES, _rotated, needs_direction=True),
    MadeFault("mirrored piece", "of the frame", (0.2, 0.5, 1.0), _mirrored, True),
    MadeFault("other scale", "of the taught value", (1.02, 1.05, 1.1), _scaled),
    MadeFault("darker", "of the taught value", (0.9, 0.75, 0.5), _darker),
    MadeFault("deeper relief", "of the taught value", (1.1, 1.2, 1.4), _deeper),
)
"""One row for each kind of fault; the strengths rise."""
