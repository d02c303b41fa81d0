"""The metadata of a captured set: the JSON inside its file."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, StrictBool, StrictInt

from classify import Lighting, SensorNoise
from classify.base.models import Record
from classify.images import ROUNDING_VARIANCE
from rig import ControllerIdentity, Placement

if TYPE_CHECKING:
    from classify.lights.agreement import LightAgreement

_Vector = tuple[float, float, float]
# Wider than the range of any camera; squares and quotients stay finite in float32.
_Gain = Annotated[float, Field(ge=1e-6, le=1e6)]
_PixelValue = Annotated[float, Field(ge=0.0, le=65535.0)]


def _printable(text: str | None) -> str | None:
    if text is not None and not text.isprintable():
        raise ValueError("use printable characters only")
    return text


_Text = Annotated[str, AfterValidator(_printable)]
# Value of a property of a specimen; dates are ISO 8601.
Property = StrictBool | Annotated[StrictInt, Field(ge=-(2**63), lt=2**63)] | float | _Text


class LightingRecord(Record):
    """Unit vectors, intensities and, for near lights, positions, as in `Lighting`."""

    directions: tuple[_Vector, ...] = Field(min_length=1)
    intensities: tuple[float, ...]
    intensities_given: bool
    positions_px: tuple[_Vector, ...] | None = None

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
        positions = None if self.positions_px is None else np.array(self.positions_px)
        are_given = self.intensities_given or any(
            intensity != 1.0 for intensity in self.intensities
        )
        intensities = np.array(self.intensities if are_given else ())
        return Lighting(np.array(self.directions), intensities, positions)


class FrameRecord(Record):
    """One frame that went into an image; times on the rig's monotonic clock."""

    sequence: int
    exposure_start_s: float
    exposure_end_s: float


class ImageRecord(Record):
    """The origin of an image: frames under one light (None: ambient), or a file."""

    light: int | None
    frames: tuple[FrameRecord, ...] = ()
    led_acknowledged_s: float | None = None
    led_level_percent: int | None = None
    controller_time_us: int | None = None
    stale_frames: int = 0
    corrupt_frames: int = 0
    repeated_frames: int = 0
    lost_frames: int = 0
    exposures_us: tuple[tuple[int, int], ...] = ()
    triggers_us: tuple[int, ...] = ()
    source_file: str | None = None


class CameraRecord(Record):
    """The camera with its settings as read back; noise is in the camera's own pixel values."""

    kind: str
    name: str
    exposure_ms: float
    frame_rate_hz: float
    gain_e_per_dn: _Gain | None
    read_noise_dn: _PixelValue | None
    black_level_dn: _PixelValue | None
    gain: float | None
    gamma: float | None
    pixel_value_controls: dict[str, float]
    controls: dict[str, Any] = Field(default_factory=dict)

    @property
    def noise(self) -> SensorNoise | None:
        """Noise of a frame in the camera's pixel values; None if it is not known."""
        if self.gain_e_per_dn is None or self.read_noise_dn is None:
            return None
        return SensorNoise(self.gain_e_per_dn, self.read_noise_dn, self.black_level_dn or 0.0)


_LightOrder = Literal["confirmed", "undecided"]


class ChecksRecord(Record):
    """Results of the checks of the lights from the images of a set."""

    ambient_change: float | None
    redundancy_residual: float | None
    light_levels: tuple[float, ...] | None
    light_levels_error: float | None
    levels_corrected: bool = False  # whether the intensities of the lights contain the levels
    retaken: bool
    light_order: _LightOrder
    undecided: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        agreement: "LightAgreement | None",
        light_order: _LightOrder,
        ambient_change: float | None = None,
        undecided: tuple[str, ...] = (),
    ) -> Self:
        """Make the record of a set, which was retaken if a check was undecided."""
        levels = None if agreement is None else agreement.levels
        return cls(
            ambient_change=ambient_change,
            redundancy_residual=None if agreement is None else agreement.redundancy_residual,
            light_levels=levels,
            light_levels_error=None
            if agreement is None or levels is None
            else agreement.level_error,
            retaken=bool(undecided),
            light_order=light_order,
            undecided=undecided,
        )


class CorrectionRecord(Record):
    """A correction of a field after the capture: date, earlier value, new value."""

    corrected_utc: str
    field: (
        Literal["label", "specimen", "operator", "note", "orientation_deg"]
        | Annotated[str, Field(pattern=r"^properties\.")]
    )
    before: Property | None
    after: Property | None


class SetMetadata(Record):
    """The metadata of a captured set; ``reference/files.md`` lists all fields."""

    schema_version: Literal[6] = Field(default=6, description="sets of another version are refused")
    label: _Text | None = Field(description="texture class of the part")
    specimen: _Text | None = Field(default=None, description="the piece")
    operator: _Text | None = Field(default=None, description="who captured it")
    note: _Text | None = Field(default=None, description="anything else")
    properties: dict[str, Property] = Field(
        default_factory=dict,
        description="further values of the piece by name: texts, numbers, truth values, dates",
    )
    created_utc: str = Field(description="time of capture or import")
    simulated: bool = Field(description="whether the images are simulated")
    bit_depth: int = Field(ge=1, le=16, description="of the camera")
    full_scale: int = Field(ge=1, le=65535, description="pixel value of saturation")
    lighting: LightingRecord = Field(
        description="unit vectors to the lights, intensities, positions"
    )
    images: tuple[ImageRecord, ...] = Field(
        description="light, switch times, frames that count and that do not; or the source file"
    )
    orientation_deg: float | None = Field(default=None, description="of the part, anticlockwise")
    placement: Placement | None = Field(default=None, description="of a simulated part")
    rig_name: str | None = Field(default=None, description="name in rig.toml")
    settle_ms: float | None = Field(default=None, description="of the rig's lights")
    synchronisation: Literal["software", "strobe", "trigger"] | None = Field(
        default=None, description="what switched the lights"
    )
    camera: CameraRecord | None = Field(
        default=None, description="with its settings as read back, and its noise"
    )
    controller: ControllerIdentity | None = Field(
        default=None, description="serial number and versions"
    )
    checks: ChecksRecord | None = Field(
        default=None,
        description="ambient change, redundancy residual, LED levels with their error, order",
    )
    failed_attempts: tuple[str, ...] = Field(
        default=(), description="reasons for the failure of earlier attempts"
    )
    gamma: str = Field(default="linear", description="response of photographs that was undone")
    gamma_source: Literal["stated", "given", "assumed"] | None = Field(
        default=None, description="by the files, by the user, by default"
    )
    photographed: _Text | None = Field(
        default=None, description="date of photographs; local time if it has no offset"
    )
    calibration_ids: tuple[str, ...] = Field(default=(), description="SHA-256 of the calibration")
    mm_per_px: float | None = Field(
        default=None,
        ge=1e-6,
        le=1e3,
        description="scale by that calibration, or as given at import",
    )
    crop: tuple[int, int, int, int] | None = Field(
        default=None, description="column, row, width, height that were kept of photographs"
    )
    mask_file: str | None = Field(default=None, description="name of the mask of photographs")
    warnings: tuple[str, ...] = Field(default=(), description="of the checks of an import")
    accepted: tuple[str, ...] = Field(
        default=(), description="causes for a refusal of an import that were accepted"
    )
    corrections: tuple[CorrectionRecord, ...] = Field(
        default=(), description="by info --set: date, field, value before and after"
    )
    software_version: str = Field(description="of ps4rig")
    pixels_sha256: str = Field(description="over all pages in order, as 16-bit little-endian rows")

    @property
    def capture_date(self) -> str | None:
        """Date of the capture; None for imported photographs that do not state theirs."""
        is_imported = any(image.source_file is not None for image in self.images)
        return self.photographed if is_imported else self.created_utc

    @property
    def facts(self) -> Iterator[tuple[str, str]]:
        """Yield the dates, and the response of imported photographs, with their names."""
        if self.capture_date is not None:
            yield "captured", self.capture_date + (" (simulated)" if self.simulated else "")
        if self.capture_date != self.created_utc:
            yield "imported", self.created_utc
        if self.gamma_source is not None:
            yield "response", f"{self.gamma} ({self.gamma_source})"


def image_noise(
    sensor: SensorNoise | None, bit_depth: int, full_scale: int, frames: int
) -> SensorNoise | None:
    """Return the noise of means of `frames` frames of a sensor, stretched to `full_scale`."""
    if sensor is None:
        return None
    stretch = full_scale / ((1 << bit_depth) - 1)
    # Each frame was rounded before the mean.
    rounding = ROUNDING_VARIANCE if frames > 1 else 0.0
    return SensorNoise(
        gain_e_per_dn=sensor.gain_e_per_dn * frames / stretch,
        read_noise_dn=stretch * math.sqrt((sensor.read_noise_dn**2 + rounding) / frames),
        black_level_dn=stretch * sensor.black_level_dn,
    )
