"""A captured set that a simulated camera replays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from classify import Lighting
from classify.errors import InputError
from rig.camera import Pixels
from rig.scene.surfaces import FloatImage
from rig.set_file import Planes, read_set_file

__all__ = ["RecordedPixels", "RecordedSet", "read_recorded_set"]

# Largest difference of unit vectors, 0.06 degrees: directions of the same lights differ by the
# rounding of angles only.
_SAME_DIRECTION = 1e-3


@dataclass(frozen=True)
class RecordedPixels:
    """Takes the place of a sensor: recorded pixel values, which have their noise already.

    A light that is on for half of an exposure adds half of its recorded values.
    """

    bit_depth: int
    exposure_ms: float
    gain_e_per_dn: float | None
    read_noise_dn: float | None
    black_level_dn: float | None

    def expose(self, light_ms: FloatImage, _rng: np.random.Generator) -> Pixels:
        """Pixel values for an exposure; `light_ms` is pixel values times milliseconds."""
        values = np.rint(light_ms / np.float32(self.exposure_ms))
        np.clip(values, 0, (1 << self.bit_depth) - 1, out=values)
        pixels: Pixels = values.astype(np.uint8 if self.bit_depth == 8 else np.uint16)
        return pixels


@dataclass(frozen=True, eq=False)
class RecordedSet:
    """A set as the scene of a simulated camera.

    Attributes
    ----------
    lights, ambient
        (N, H, W) and (H, W) float32 pixel values: what each light adds, and the ambient image.
    lighting
        The lights of the set.
    full_scale, noise
        Pixel value of saturation, and the fields of the noise model.
    origin
        Identity of the set, for the metadata of what is captured from it.
    """

    lights: FloatImage
    ambient: FloatImage
    lighting: Lighting
    full_scale: int
    noise: dict[str, float | None]
    origin: dict[str, Any]

    def require_lighting(self, lighting: Lighting) -> None:
        """Raise `InputError` if the rig's lights have other directions than those of the set."""
        mine, theirs = self.lighting.directions, lighting.directions
        if mine.shape != theirs.shape or np.abs(mine - theirs).max() > _SAME_DIRECTION:
            raise InputError(
                f"{self.origin['set_file']}: was lit from tilts "
                f"{_degrees(self.lighting.tilts_deg)} at slants "
                f"{_degrees(self.lighting.slants_deg)}; set lights.tilts_deg and lights.slant_deg "
                "to these"
            )

    def pixels(self, exposure_ms: float) -> RecordedPixels:
        """The sensor that turns an exposure of `exposure_ms` into the recorded pixel values."""
        return RecordedPixels(self.full_scale.bit_length(), exposure_ms, **self.noise)


def read_recorded_set(path: Path) -> RecordedSet:
    """Read a captured set to replay it.

    Raises
    ------
    InputError
        As `read_set_file`, or if a metadata field that a camera needs is missing or wrong.
    """
    planes, fields = read_set_file(path)
    try:
        return _recorded(path, planes, fields)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: cannot be replayed: metadata: {error}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _recorded(path: Path, planes: Planes, fields: dict[str, Any]) -> RecordedSet:
    directions = np.array(fields["lighting"]["directions"], np.float64)
    count, full_scale, bits = len(directions), fields["full_scale"], fields["bit_depth"]
    if len(planes) not in (count, count + 1):
        raise ValueError(f"{len(planes)} images for {count} lights")
    if full_scale not in (255, 1023, 4095, 65535):
        raise ValueError(f"full scale {full_scale}")
    if bits not in range(1, 17):
        raise ValueError(f"bit depth {bits}")
    values = planes.astype(np.float32)
    ambient = values[count] if len(values) > count else np.zeros_like(values[0])
    camera = fields.get("camera") or {}
    # The noise is in the camera's own pixel values, from which an average is stretched.
    own_scale = full_scale == (1 << bits) - 1
    names = ("gain_e_per_dn", "read_noise_dn", "black_level_dn")
    return RecordedSet(
        lights=values[:count] - ambient,
        ambient=ambient,
        lighting=Lighting(directions, np.array(fields["lighting"]["intensities"], np.float64)),
        full_scale=full_scale,
        noise={name: _number(camera.get(name)) if own_scale else None for name in names},
        origin={
            "set_file": str(path),
            "pixels_sha256": fields["pixels_sha256"],
            "created_utc": fields["created_utc"],
            "label": fields["label"],
            "simulated": fields["simulated"],
            "camera": camera.get("name"),
        },
    )


def _number(value: float | None) -> float | None:
    if value is not None and not 0.0 <= float(value) <= 1e6:
        raise ValueError(f"camera noise {value}")
    return value


def _degrees(angles: npt.NDArray[np.float64]) -> str:
    return ", ".join(f"{angle:g}" for angle in np.round(angles, 1))
