"""A captured set read to be played back: its pages, and what a camera needs to know of them.

The file is written by ``capture``; here stands what its README promises every reader: 16-bit pages,
the lights in order and then the ambient image, and JSON in an annotation of the OME-XML.
"""

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

# A direction that was stored and one that is computed differ by rounding only.
_SAME_DIRECTION = 1e-3


@dataclass(frozen=True)
class RecordedPixels:
    """In place of a sensor: pixel values as they were recorded, their noise with them.

    A frame that a light was on for half of is half of what the light made, as in a camera.
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
    """What a camera would have to show for a set to come out again.

    Attributes
    ----------
    lights, ambient
        (N, H, W) and (H, W) float32 pixel values: what each light adds, and what is there without.
    lighting
        Where the lights stood.
    origin
        Which set it was, for the metadata of what is made of it.
    """

    lights: FloatImage
    ambient: FloatImage
    lighting: Lighting
    full_scale: int
    noise: dict[str, float | None]
    origin: dict[str, Any]

    def require_lighting(self, lighting: Lighting) -> None:
        """Raise `InputError` if the rig's lights stand elsewhere than those of the set."""
        mine, theirs = self.lighting.directions, lighting.directions
        if mine.shape != theirs.shape or np.abs(mine - theirs).max() > _SAME_DIRECTION:
            raise InputError(
                f"{self.origin['set_file']}: was lit from tilts "
                f"{_degrees(self.lighting.tilts_deg)} at slants "
                f"{_degrees(self.lighting.slants_deg)}; set lights.tilts_deg and lights.slant_deg "
                "to that"
            )

    def pixels(self, exposure_ms: float) -> RecordedPixels:
        """What makes frames of this exposure look like the recorded ones."""
        return RecordedPixels(self.full_scale.bit_length(), exposure_ms, **self.noise)


def read_recorded_set(path: Path) -> RecordedSet:
    """Read a captured set to play it back.

    Raises
    ------
    InputError
        As `read_set_file`, or if a metadata field that a camera needs is missing or wrong.
    """
    planes, fields = read_set_file(path)
    try:
        return _recorded(path, planes, fields)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: cannot be played back: metadata: {error}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _recorded(path: Path, planes: Planes, fields: dict[str, Any]) -> RecordedSet:
    directions = np.array(fields["lighting"]["directions"], np.float64)
    count, full_scale = len(directions), int(fields["full_scale"])
    if len(planes) not in (count, count + 1):
        raise ValueError(f"{len(planes)} images for {count} lights")
    if full_scale not in (255, 1023, 4095, 65535):
        raise ValueError(f"full scale {full_scale}")
    values = planes.astype(np.float32)
    ambient = values[count] if len(values) > count else np.zeros_like(values[0])
    camera = fields.get("camera") or {}
    # The noise is said in the camera's own pixel values, an average is stretched from there.
    own_scale = full_scale == (1 << int(fields["bit_depth"])) - 1
    names = ("gain_e_per_dn", "read_noise_dn", "black_level_dn")
    return RecordedSet(
        lights=values[:count] - ambient,
        ambient=ambient,
        lighting=Lighting(directions, np.array(fields["lighting"]["intensities"], np.float64)),
        full_scale=full_scale,
        noise={name: camera.get(name) if own_scale else None for name in names},
        origin={
            "set_file": str(path),
            "pixels_sha256": fields["pixels_sha256"],
            "created_utc": fields["created_utc"],
            "label": fields["label"],
            "simulated": fields["simulated"],
            "camera": camera.get("name"),
        },
    )


def _degrees(angles: npt.NDArray[np.float64]) -> str:
    return ", ".join(f"{angle:g}" for angle in np.round(angles, 1))
