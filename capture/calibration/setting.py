"""The setting of a rig for which a part of a calibration holds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self, get_args

import numpy as np
from pydantic import Field

from classify.base.models import Record
from classify.calibration.dark import SAME_EXPOSURE
from classify.lighting import angles_between_deg

if TYPE_CHECKING:
    from rig import CameraInfo, Rig

PartName = Literal["dark", "response", "noise", "flat_field", "lights", "scale"]
PART_NAMES: Final[tuple[PartName, ...]] = get_args(PartName)

# The parts that depend on more than camera and frame. Response and noise are functions of the pixel
# value. Dark current and hot pixels grow with the exposure. Flat field and lights are ratios of
# images under the lights.
_DEPENDS_ON_PIXEL_VALUES: tuple[PartName, ...] = ("dark", "response", "noise")
_DEPENDS_ON_EXPOSURE: tuple[PartName, ...] = ("dark",)
_DEPENDS_ON_LIGHTS: tuple[PartName, ...] = ("flat_field", "lights")

# Directions of lights are measured and typed into rig.toml with about this accuracy.
_MAX_LIGHT_CHANGE_DEG = 0.5

_Vector = tuple[float, float, float]
_Side = Annotated[int, Field(ge=1, le=32768)]


class Setting(Record):
    """Camera, frame and lights of one set or one measurement; unknown values are None."""

    simulated: bool
    rig_name: str | None
    camera: str | None
    width_px: _Side
    height_px: _Side
    crop: tuple[int, int, int, int] | None = None
    bit_depth: int = Field(ge=1, le=16)
    exposure_ms: float | None
    gain: float | None = None
    gamma: float | None = None
    pixel_value_controls: dict[str, float] = Field(default_factory=dict)
    photograph_gamma: str = "linear"
    light_directions: tuple[_Vector, ...] = Field(max_length=255)
    # Those of ``rig.toml`` or of an import; empty if unknown.
    light_intensities: tuple[float, ...] = Field(default=(), max_length=255)
    led_levels_percent: tuple[int | None, ...] = Field(default=(), max_length=255)

    @classmethod
    def of_photographs(cls, shape: tuple[int, ...], bit_depth: int, gamma: str) -> Self:
        """Return the setting of single photographs of `shape`, without lights and exposure."""
        return cls(
            simulated=False, rig_name=None, camera=None, width_px=shape[1], height_px=shape[0],
            bit_depth=bit_depth, exposure_ms=None, photograph_gamma=gamma, light_directions=(),
        )  # fmt: skip

    @classmethod
    def of_rig(cls, rig: Rig) -> Self:
        """Return the setting of an open rig."""
        info: CameraInfo = rig.camera.info
        levels = rig.lights.state().levels_percent[: len(rig.lighting)]
        return cls(
            simulated=rig.is_simulated,
            rig_name=rig.config.name,
            camera=None if info.kind == "replay" else f"{info.kind} {info.name}",
            width_px=info.width_px,
            height_px=info.height_px,
            bit_depth=info.bit_depth,
            exposure_ms=1000.0 * info.exposure_s,
            gain=info.gain,
            gamma=info.gamma,
            pixel_value_controls=dict(info.pixel_value_controls),
            light_directions=tuple((x, y, z) for x, y, z in rig.lighting.directions.tolist()),
            light_intensities=tuple(rig.lighting.intensities.tolist()),
            led_levels_percent=tuple(levels),
        )

    def differences(self, other: Setting, part: PartName) -> list[str]:
        """Differences of `other` that invalidate a `part` measured at this setting, in words."""
        return list(self._differences(other, part))

    def all_differences(self, other: Setting) -> list[str]:
        """Differences that keep sets of `other` from being judged like sets of this setting."""
        # Dark depends on pixel values and exposure, flat_field on the lights.
        parts: tuple[PartName, ...] = ("dark", "flat_field")
        differences = [text for part in parts for text in self._differences(other, part)]
        return list(dict.fromkeys(differences)) or [
            *self._moved_lights(other),
            *self._other_intensities(other),
        ]

    def _differences(self, other: Setting, part: PartName) -> Iterator[str]:
        if self.simulated != other.simulated:
            yield "one is simulated and the other is not"
        for name, our_name, their_name in (
            ("rig", self.rig_name, other.rig_name),
            ("camera", self.camera, other.camera),
        ):
            if our_name is not None and their_name is not None and our_name != their_name:
                yield f"{name} {their_name!r} instead of {our_name!r}"
        if (self.width_px, self.height_px) != (other.width_px, other.height_px):
            yield f"{other._size} instead of {self._size}"
        elif self.crop != other.crop:
            yield f"crop {other.crop} instead of {self.crop}"
        if part in _DEPENDS_ON_PIXEL_VALUES:
            if self.bit_depth != other.bit_depth:
                yield f"{other.bit_depth} bit instead of {self.bit_depth}"
            if self.photograph_gamma != other.photograph_gamma:
                yield (
                    f"photographs taken as {other.photograph_gamma} instead of "
                    f"{self.photograph_gamma}"
                )
            ours, theirs = self._controls, other._controls
            for name in sorted(ours.keys() & theirs.keys()):
                if ours[name] != theirs[name]:
                    yield f"{name} {theirs[name]:g} instead of {ours[name]:g}"
        if part in _DEPENDS_ON_EXPOSURE and self.exposure_ms and other.exposure_ms:
            change = abs(other.exposure_ms / self.exposure_ms - 1.0)
            if change > SAME_EXPOSURE:
                yield f"exposure {other.exposure_ms:g} ms instead of {self.exposure_ms:g} ms"
        if part in _DEPENDS_ON_LIGHTS:
            yield from self._other_lights(other)

    def _other_lights(self, other: Setting) -> Iterator[str]:
        ours, theirs = np.array(self.light_directions), np.array(other.light_directions)
        if len(ours) != len(theirs):
            yield f"{len(theirs)} lights instead of {len(ours)}"
        elif (np.argmax(theirs @ ours.T, axis=1) != np.arange(len(ours))).any():
            yield "lights in another order"
        elif None not in (*self.led_levels_percent, *other.led_levels_percent) and (
            self.led_levels_percent != other.led_levels_percent
        ):
            yield (
                f"LEDs driven at {_listed(other.led_levels_percent)} instead of "
                f"{_listed(self.led_levels_percent)} %"
            )

    def _other_intensities(self, other: Setting) -> Iterator[str]:
        # Images are divided by them: at half the intensities a part half as bright has the same
        # albedo.
        ours, theirs = self.light_intensities, other.light_intensities
        if ours and theirs and not np.allclose(ours, theirs):
            yield f"intensities of the lights {_listed(theirs)} instead of {_listed(ours)}"

    def _moved_lights(self, other: Setting) -> Iterator[str]:
        # At a slant of 45 degrees in place of 40 slopes are 16 % smaller: a deeper relief passes.
        ours, theirs = (np.reshape(setting.light_directions, (-1, 3)) for setting in (self, other))
        angle_deg = float(angles_between_deg(ours, theirs).max(initial=0.0))
        if angle_deg > _MAX_LIGHT_CHANGE_DEG:
            yield f"the direction of a light differs by {angle_deg:.1f} degrees"

    @property
    def _controls(self) -> dict[str, float]:
        controls = {"gain": self.gain, "gamma": self.gamma}
        stated = {name: value for name, value in controls.items() if value is not None}
        return {**stated, **self.pixel_value_controls}

    @property
    def _size(self) -> str:
        return f"{self.width_px} x {self.height_px} px"


def _listed(levels: Iterable[Any]) -> str:
    return ", ".join(f"{level:.4g}" for level in levels)
