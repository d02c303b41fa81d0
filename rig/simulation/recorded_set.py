"""A captured set that a simulated camera replays."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from classify import InputError, Lighting
from classify.base.arrays import FloatMap, Floats
from rig.set_file import Planes, read_set_file

from .sensor import RecordedPixels

# Largest difference of unit vectors, 0.06 degrees: directions of the same lights differ by the
# rounding of angles only.
_SAME_DIRECTION = 1e-3


@dataclass(frozen=True, eq=False)
class _RecordedSet:
    """A set as the scene of a simulated camera."""

    lights: FloatMap  # (N, H, W) float32 pixel values that each light adds
    ambient: FloatMap  # (H, W) float32 pixel values
    lighting: Lighting
    sensor: RecordedPixels

    def require_lighting(self, lighting: Lighting) -> None:
        """Raise `InputError` if the rig's lights have other directions than those of the set."""
        own, other = self.lighting.directions, lighting.directions
        if own.shape != other.shape or np.abs(own - other).max() > _SAME_DIRECTION:
            raise InputError(
                f"{self.sensor.origin['set_file']}: was lit from tilts "
                f"{_degrees(self.lighting.tilts_deg)} at slants "
                f"{_degrees(self.lighting.slants_deg)}; set lights.tilts_deg and lights.slant_deg "
                "to these"
            )


def read_recorded_set(path: Path, exposure_ms: float) -> _RecordedSet:
    """Read a captured set, to replay it with an exposure of `exposure_ms`."""
    planes, fields = read_set_file(path)
    try:
        return _recorded(path, planes, fields, exposure_ms)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: cannot be replayed: metadata: {error}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _recorded(
    path: Path, planes: Planes, fields: dict[str, Any], exposure_ms: float
) -> _RecordedSet:
    directions = np.array(fields["lighting"]["directions"], np.float64)
    count, full_scale, bits = len(directions), fields["full_scale"], fields["bit_depth"]
    if fields.get("mask_file") is not None:
        planes = planes[:-1]  # a camera sees the whole frame
    if len(planes) not in (count, count + 1):
        raise ValueError(f"{len(planes)} images for {count} lights")
    if full_scale not in (255, 1023, 4095, 65535):
        raise ValueError(f"full_scale is {full_scale!r:.40}; it must be 255, 1023, 4095 or 65535")
    if bits not in range(1, 17):
        raise ValueError(f"bit_depth is {bits!r:.40}; it must be 1 to 16")
    values = planes.astype(np.float32)
    ambient = values[count] if len(values) > count else np.zeros_like(values[0])
    camera = fields.get("camera") or {}
    # The noise is in the camera's own pixel values. Means of frames are stretched to 16 bits.
    is_unstretched = full_scale == (1 << bits) - 1
    names = ("gain_e_per_dn", "read_noise_dn", "black_level_dn")
    origin = {key: fields[key] for key in ("pixels_sha256", "created_utc", "label", "simulated")}
    sensor = RecordedPixels(
        full_scale.bit_length(),
        exposure_ms,
        {"set_file": str(path), **origin, "camera": camera.get("name")},
        **{name: _number(camera.get(name)) if is_unstretched else None for name in names},
        info_fields={
            "gain": _number(camera.get("gain")),
            "gamma": _number(camera.get("gamma")),
            "pixel_value_controls": {
                name: float(value) for name, value in camera.get("pixel_value_controls", {}).items()
            },
        },
    )
    return _RecordedSet(
        lights=values[:count] - ambient,
        ambient=ambient,
        lighting=Lighting(directions, np.array(fields["lighting"]["intensities"], np.float64)),
        sensor=sensor,
    )


def _number(value: float | None) -> float | None:
    if value is not None and not 0.0 <= float(value) <= 1e9:
        raise ValueError(f"a noise value or gain of the camera is {value}; it must be 0 to 1e9")
    return value


def _degrees(angles: Floats) -> str:
    return ", ".join(f"{angle:g}" for angle in np.round(angles, 1))
