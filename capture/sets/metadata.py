"""The metadata of a captured set: the JSON inside its file."""

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, FiniteFloat, StrictBool, StrictInt

from classify import Lighting
from classify.images.noise import ROUNDING_VARIANCE, SensorNoise
from rig import Placement
from rig.config.section import Record

UNPROTECTED = (
    "a set of schema 1: its metadata have no hash, so that a change of lights or label after the "
    "capture cannot be noticed"
)
Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
# Wider than the range of any camera; squares and quotients stay finite in float32.
Gain = Annotated[float, Field(ge=1e-6, le=1e6)]
PixelValue = Annotated[float, Field(ge=0.0, le=65535.0)]


def _printable(text: str | None) -> str | None:
    # "unknown", which `checked_label` refuses, is accepted: older sets may have that label.
    if text is not None and not text.isprintable():
        raise ValueError("use printable characters only")
    return text


Text = Annotated[str, AfterValidator(_printable)]
# What a plan may say of a specimen beside its note; dates are ISO 8601.
Property = StrictBool | Annotated[StrictInt, Field(ge=-(2**63), lt=2**63)] | FiniteFloat | Text
PROPERTY_PREFIX = "properties."


class _Record(Record):
    # The aliases are the keys in files. Some keep an older word than the attribute.
    model_config = ConfigDict(populate_by_name=True)


class LightingRecord(_Record):
    """Unit vectors towards the lights (x right, y up, z to the camera) and their intensities.

    `intensities_given` is as for `Lighting`. Older sets do not hold it; intensities other than 1
    always count as given. `positions_px` are those of near lights, and None for distant ones.
    """

    directions: tuple[Vector, ...] = Field(min_length=1)
    intensities: tuple[FiniteFloat, ...]
    intensities_given: bool = False
    positions_px: tuple[Vector, ...] | None = None

    @classmethod
    def of(cls, lighting: Lighting) -> Self:
        """Make the record of a `Lighting`."""
        positions = lighting.positions_px
        return cls(
            directions=tuple((x, y, z) for x, y, z in lighting.directions.tolist()),
            intensities=tuple(lighting.intensities.tolist()),
            intensities_given=lighting.intensities_given,
            positions_px=positions if positions is None else tuple(map(tuple, positions.tolist())),
        )

    def to_lighting(self) -> Lighting:
        """Return the `Lighting` of the record."""
        given = self.intensities_given or any(each != 1.0 for each in self.intensities)
        positions = None if self.positions_px is None else np.array(self.positions_px)
        return Lighting(
            np.array(self.directions), np.array(self.intensities if given else ()), positions
        )


class FrameRecord(_Record):
    """One frame that went into an image; times on the rig's monotonic clock."""

    sequence: int
    exposure_start_s: FiniteFloat
    exposure_end_s: FiniteFloat


class ImageRecord(_Record):
    """The origin of an image: frames under one light, or a file.

    `light` is the index into the lighting, None for the ambient image. `led_acknowledged_s` and
    `controller_time_us` are the time of the switch on the clocks of rig and controller.
    `led_level_percent` is the drive level of the LED. `stale_frames` were exposed before the switch
    and left out, `repeated_frames` came twice, `lost_frames` are gaps in the sequence numbers. With
    a sequence of the controller, `exposures_us` are the edges of the strobe for each frame and
    `triggers_us` the triggers, on the controller's clock.
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
    """The camera with its settings as read back from it.

    Gain, read noise and black level are in the camera's own pixel values, up to
    2^bit_depth - 1. Averaged images are stretched from there to `full_scale`.
    """

    kind: str
    name: str
    exposure_ms: FiniteFloat
    frame_rate_hz: FiniteFloat
    gain_e_per_dn: Gain | None
    read_noise_dn: PixelValue | None
    black_level_dn: PixelValue | None
    controls: dict[str, Any] = Field(default_factory=dict)

    @property
    def noise(self) -> SensorNoise | None:
        """Noise of a frame in the camera's pixel values; None if it is not known."""
        if self.gain_e_per_dn is None or self.read_noise_dn is None:
            return None
        return SensorNoise(self.gain_e_per_dn, self.read_noise_dn, self.black_level_dn or 0.0)


class ControllerRecord(_Record):
    """The light controller that switched the LEDs."""

    vendor: str
    model: str
    serial_number: str
    firmware_version: str
    protocol_version: int


class ChecksRecord(_Record):
    """Results of the checks of the lights from the images of a set.

    Attributes
    ----------
    ambient_change
        Change between two ambient images, as a share of an LED's light; None for one image.
    redundancy_residual
        rms residual beyond noise, as a share of the signal; None without four lights in general
        position.
    light_levels, light_levels_error
        LED levels that explain the light images, and their standard error; None if no levels do.
    retaken
        Whether the light images agreed with a retake; False if there was none.
    light_order
        Order of the lights by the shading: ``confirmed`` or ``undecided``.
    undecided
        Reasons for the retake: checks that the light images alone left undecided.
    """

    ambient_change: FiniteFloat | None
    redundancy_residual: FiniteFloat | None = Field(alias="contradiction")
    light_levels: tuple[FiniteFloat, ...] | None = Field(alias="light_strengths")
    light_levels_error: FiniteFloat | None = Field(alias="light_strengths_error")
    retaken: bool = Field(alias="second_look")
    light_order: Literal["confirmed", "undecided"]
    undecided: tuple[str, ...] = ()


class CorrectionRecord(_Record):
    """A correction of a field after the capture: date, earlier value, new value."""

    corrected_utc: str
    field: (
        Literal["label", "specimen", "operator", "note", "orientation_deg"]
        | Annotated[str, Field(pattern=r"^properties\.")]
    )
    before: Property | None
    after: Property | None


class SetMetadata(_Record):
    """The metadata of a captured set.

    Attributes
    ----------
    bit_depth, full_scale
        Bit depth of the camera, and the pixel value of saturation in the images.
    images
        One record for each image, in the order of the lighting, then the ambient image.
    specimen, operator, note
        Which piece it is, who captured it, and anything else; None if not given.
    properties
        Further values of the specimen, by name.
    orientation_deg
        Orientation of the part, None if unknown.
    corrections
        Fields that were changed after the capture, the oldest correction first.
    placement
        Placement of the simulated part, None for a real one.
    synchronisation
        As ``lights.synchronisation`` in rig.toml; None for imported images.
    failed_attempts
        Reason for the failure of each earlier attempt.
    gamma
        Response of imported photographs that was undone: ``linear`` or ``srgb``.
    calibration_ids
        Hashes of the calibrations that apply to the set.
    mm_per_px
        Scale of the image by this calibration, for the programs that only read the file; None if
        it was not measured.
    crop
        Column and row of the top left pixel, width and height of the part of the imported
        photographs that was kept; None for all.
    mask_file
        Name of the image with the mask; None for a set without a mask.
    warnings, accepted
        What the checks of imported photographs found but did not refuse, and the causes for a
        refusal that were accepted.
    """

    schema_version: Literal[1, 2, 3, 4, 5] = 5
    label: Text | None
    specimen: Text | None = None
    operator: Text | None = None
    note: Text | None = None
    properties: dict[str, Property] = Field(default_factory=dict)
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
    failed_attempts: tuple[str, ...] = Field(default=(), alias="retries")
    gamma: str = "linear"
    calibration_ids: tuple[str, ...] = ()
    mm_per_px: float | None = Field(default=None, ge=1e-6, le=1e3)
    crop: tuple[int, int, int, int] | None = None
    mask_file: str | None = None
    warnings: tuple[str, ...] = ()
    accepted: tuple[str, ...] = ()
    corrections: tuple[CorrectionRecord, ...] = ()
    software_version: str
    pixels_sha256: str

    @property
    def is_protected(self) -> bool:
        """Whether the file has a hash over its metadata: from schema version 2 on."""
        return self.schema_version > 1


def image_noise(
    sensor: SensorNoise | None, bit_depth: int, full_scale: int, frames: int
) -> SensorNoise | None:
    """Return the noise of images that are each the mean of `frames` frames of a sensor.

    The mean of n frames is stretched by s = full_scale / (2^bit_depth - 1). Its gain is n / s times
    that of the camera. Its read noise is s sqrt((r^2 + 1/12) / n) with the camera's read noise r;
    1/12 is the variance of rounding each frame.
    """
    if sensor is None:
        return None
    stretch = full_scale / ((1 << bit_depth) - 1)
    rounding = ROUNDING_VARIANCE if frames > 1 else 0.0
    return SensorNoise(
        gain_e_per_dn=sensor.gain_e_per_dn * frames / stretch,
        read_noise_dn=stretch * math.sqrt((sensor.read_noise_dn**2 + rounding) / frames),
        black_level_dn=stretch * sensor.black_level_dn,
    )
