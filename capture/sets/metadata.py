"""What is known about the images of a captured set: the JSON inside its file."""

from __future__ import annotations

import math
from typing import Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from classify import Lighting
from classify.errors import InputError
from classify.images.noise import SensorNoise
from rig import Placement

__all__ = [
    "SCHEMA_VERSION",
    "CameraRecord",
    "ChecksRecord",
    "ControllerRecord",
    "FrameRecord",
    "ImageRecord",
    "LightingRecord",
    "SetMetadata",
    "checked_label",
    "image_noise",
]

SCHEMA_VERSION = 1
Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class LightingRecord(_Record):
    """Unit vectors towards the lights (x right, y up, z to the camera) and their intensities."""

    directions: tuple[Vector, ...] = Field(min_length=1)
    intensities: tuple[FiniteFloat, ...]

    @classmethod
    def of(cls, lighting: Lighting) -> Self:
        """The record of a `Lighting`."""
        return cls(
            directions=tuple((x, y, z) for x, y, z in lighting.directions.tolist()),
            intensities=tuple(lighting.intensities.tolist()),
        )

    def to_lighting(self) -> Lighting:
        """The `Lighting` of a record."""
        return Lighting(np.array(self.directions), np.array(self.intensities))


class FrameRecord(_Record):
    """One frame that went into an image; times on the rig's monotonic clock."""

    sequence: int
    exposure_start_s: FiniteFloat
    exposure_end_s: FiniteFloat


class ImageRecord(_Record):
    """Where an image comes from: frames under one light, or a file.

    `light` is the index into the lighting, None for the ambient image. `led_acknowledged_s` and
    `controller_time_us` say when the light was switched, on the rig's and the controller's clock;
    `led_level_percent` is how bright the LED was driven. `stale_frames` were older than the switch
    and thrown away, `repeated_frames` came twice, `lost_frames` are gaps in the sequence after it.
    In a sequence of the controller's, `exposures_us` are the edges of the strobe for each frame and
    `triggers_us` its triggers, on the controller's clock.
    """

    light: int | None
    frames: tuple[FrameRecord, ...] = ()
    led_acknowledged_s: FiniteFloat | None = None
    led_level_percent: int | None = None
    controller_time_us: int | None = None
    stale_frames: int = 0
    corrupt_frames: int = 0
    repeated_frames: int = 0
    lost_frames: int = 0
    exposures_us: tuple[tuple[int, int], ...] = ()
    triggers_us: tuple[int, ...] = ()
    source_file: str | None = None


class CameraRecord(_Record):
    """The camera as it was set, read back from it.

    Gain, read noise and black level count in the camera's own pixel values, up to
    2^bit_depth - 1; the images of an averaged set are stretched from there to `full_scale`.
    """

    kind: str
    name: str
    exposure_ms: FiniteFloat
    frame_rate_hz: FiniteFloat
    gain_e_per_dn: FiniteFloat | None
    read_noise_dn: FiniteFloat | None
    black_level_dn: FiniteFloat | None
    controls: dict[str, Any] = Field(default_factory=dict)


class ControllerRecord(_Record):
    """The light controller that switched the LEDs."""

    vendor: str
    model: str
    serial_number: str
    firmware_version: str
    protocol_version: int


class ChecksRecord(_Record):
    """What the pictures of a set were found to say about their lights.

    Attributes
    ----------
    ambient_change
        Between two pictures with all lights out, as a share of an LED's light; None where there
        was only one.
    contradiction
        rms share by which the light images contradict one another beyond noise; None if there are
        not four of them.
    light_strengths, light_strengths_error
        Relative strengths of the lights that explain the images, and their standard error; None
        where none do.
    second_look
        Whether the light images were taken a second time, and found the same.
    light_order
        By the shading: ``confirmed``, or ``undecided``.
    undecided
        Why there was a second look: what the images alone could not vouch for.
    """

    ambient_change: FiniteFloat | None
    contradiction: FiniteFloat | None
    light_strengths: tuple[FiniteFloat, ...] | None
    light_strengths_error: FiniteFloat | None
    second_look: bool
    light_order: Literal["confirmed", "undecided"]
    undecided: tuple[str, ...] = ()


class SetMetadata(_Record):
    """What a set's file says about its pixels.

    `full_scale` is the pixel value of saturation; `bit_depth` the camera's. `orientation_deg` is
    how far the part was turned, where that is known. `placement` is the simulated part.
    `synchronisation` is who moved on from light to light, see `rig.toml`. `checks` is what the
    images say about their lights, `retries` are the causes for which the set was begun again.
    """

    schema_version: Literal[1] = 1
    label: str | None
    created_utc: str
    simulated: bool
    bit_depth: int = Field(ge=1, le=16)
    full_scale: int = Field(ge=1, le=65535)
    lighting: LightingRecord
    images: tuple[ImageRecord, ...]
    orientation_deg: FiniteFloat | None = None
    placement: Placement | None = None
    rig_name: str | None = None
    settle_ms: FiniteFloat | None = None
    synchronisation: Literal["software", "strobe", "trigger"] | None = None
    camera: CameraRecord | None = None
    controller: ControllerRecord | None = None
    checks: ChecksRecord | None = None
    retries: tuple[str, ...] = ()
    gamma: str = "linear"
    calibration_ids: tuple[str, ...] = ()
    software_version: str
    pixels_sha256: str


def checked_label(label: str | None) -> str | None:
    """`label`, if people and XML can read it.

    Raises
    ------
    InputError
        For control characters, line ends and bytes that are no text.
    """
    if label is not None and not label.isprintable():
        raise InputError(f"label {label!r}: use printable characters only")
    return label


def image_noise(
    camera: CameraRecord, bit_depth: int, full_scale: int, frames: int
) -> SensorNoise | None:
    """Noise of images that are the mean of so many frames of a camera; None where it is not known.

    A camera's gain, read noise and black level count in its own pixel values. The images are
    stretched by s from there: the gain becomes gain n / s and the read noise s / sqrt(n) times
    what it is, with the rounding of each of the n frames now part of it.
    """
    if camera.gain_e_per_dn is None or camera.read_noise_dn is None:
        return None
    stretch = full_scale / ((1 << bit_depth) - 1)
    rounding = 1.0 / 12.0 if frames > 1 else 0.0
    return SensorNoise(
        gain_e_per_dn=camera.gain_e_per_dn * frames / stretch,
        read_noise_dn=stretch * math.sqrt((camera.read_noise_dn**2 + rounding) / frames),
        black_level_dn=stretch * (camera.black_level_dn or 0.0),
    )
