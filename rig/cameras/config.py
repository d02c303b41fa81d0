"""The section ``[camera]`` of ``rig.toml``: common keys, and the cameras of a simulated rig."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, Self

from pydantic import Field, field_validator, model_validator

from classify.base.errors import ConfigError
from classify.base.models import Section

from .camera import ListedCamera


class CameraConfig(Section):
    """The keys of every kind of camera."""

    kind: str = Field(description="simulated by default with simulated lights, else v4l2")
    width_px: int = Field(default=512, ge=16, le=8192, description="of the frame")
    height_px: int = Field(default=512, ge=16, le=8192, description="of the frame")
    bits: Literal[8, 10, 12, 16] = Field(
        default=12, description="of a pixel; a pixel_format determines them"
    )
    frame_rate_hz: float = Field(default=30.0, ge=0.1, le=1000.0, description="frames per second")
    exposure_ms: float = Field(
        default=20.0, gt=0.0, le=10_000.0, description="at most a frame period"
    )

    @property
    def mode(self) -> str:
        """The settings that determine the frame timing, as text."""
        return (
            f"{self._pixel_text} {self.width_px}x{self.height_px}, {self.frame_rate_hz:g} Hz, "
            f"{self.exposure_ms:g} ms"
        )

    @property
    def recording(self) -> Path | None:
        """The captured set that the camera replays; None for other cameras."""
        return None

    @property
    def _pixel_text(self) -> str:
        return f"{self.kind} {self.bits} bit"

    def _require_within_frame(self, key: str, time_ms: float) -> None:
        if time_ms > 1000.0 / self.frame_rate_hz:
            raise ValueError(
                f"{key} = {time_ms:g} does not fit into a frame at {self.frame_rate_hz:g} Hz; "
                "lower one of them"
            )

    @model_validator(mode="after")
    def _exposure_fits(self) -> Self:
        self._require_within_frame("exposure_ms", self.exposure_ms)
        return self


class StampedCameraConfig(CameraConfig):
    """A camera whose driver stamps each frame with a time."""

    timestamp_marks: Literal["frame_end", "driver", "writer"] | None = Field(
        default=None,
        description="what a stamp marks: frame_end (default); driver: what the driver declares "
        "(default if simulated); writer: when the writer of a loopback device wrote the frame",
    )
    timestamp_offset_ms: float = Field(
        default=0.0, ge=-1000.0, le=1000.0, description="added to a stamp"
    )
    timestamp_uncertainty_ms: float = Field(
        default=0.0, ge=0.0, le=1000.0, description="subtracted from a stamp"
    )
    readout_ms: float | None = Field(
        default=None,
        ge=0.0,
        le=10_000.0,
        description="from the first row's exposure to the last row's; 0 for a global shutter; by "
        "default a frame period",
    )
    timing_measured_at: str | None = Field(
        default=None,
        min_length=1,
        max_length=200,
        description="mode for which the timing holds; the camera is opened in no other",
    )

    @property
    def readout_s(self) -> float | None:
        """`readout_ms` in seconds."""
        return None if self.readout_ms is None else self.readout_ms / 1e3

    @property
    def timing_record(self) -> dict[str, Any]:
        """The keys of the time stamps, for the metadata of a set."""
        keys = StampedCameraConfig.model_fields.keys() - CameraConfig.model_fields.keys()
        marks = {"timestamp_marks": self.timestamp_marks or "frame_end"}
        return self.model_dump(include=set(keys)) | marks

    @property
    def _believes_driver(self) -> bool:
        """Whether a driver that claims to stamp the start of exposure is believed."""
        if self.timestamp_marks is None:
            return not isinstance(self, DeviceCameraConfig)
        return self.timestamp_marks == "driver"

    def exposure_start_s(
        self, stamp_s: float, *, claims_start: bool, period_s: float, exposure_s: float
    ) -> float:
        """Earliest start of the first row's exposure on the stamp's clock.

        A stamp that does not claim the start marks the end of the frame.
        """
        stamp_s += (self.timestamp_offset_ms - self.timestamp_uncertainty_ms) / 1e3
        # The kernel's driver for USB cameras declares the start of exposure and stamps the arrival
        # of the data, so a declaration counts only if the configuration confirms it.
        if self._believes_driver and claims_start:
            return stamp_s
        readout_s = period_s if self.readout_s is None else self.readout_s
        return stamp_s - readout_s - exposure_s

    @property
    def start_uncertainty_s(self) -> float:
        """Longest time by which an exposure may start after `exposure_start_s`."""
        return 2.0 * self.timestamp_uncertainty_ms / 1e3

    def require_measured_mode(self) -> None:
        """Reject a timing that was measured in another mode of the camera."""
        if self.timing_measured_at not in (None, self.mode):
            raise ConfigError(
                f"camera.timing_measured_at = {self.timing_measured_at!r}, but the camera is set "
                f"to {self.mode!r}; run ps4rig rig latency again, or remove timing_measured_at, "
                "timestamp_offset_ms, timestamp_uncertainty_ms and readout_ms"
            )

    @model_validator(mode="after")
    def _readout_fits(self) -> Self:
        if self.readout_ms is not None:
            self._require_within_frame("readout_ms", self.readout_ms)
        return self


class _PixelDepth(Protocol):
    """A pixel format, of which only the depth counts here."""

    @property
    def bit_depth(self) -> int:
        """The true one: valid values are below 2^bit_depth."""


class FormattedCameraConfig(StampedCameraConfig):
    """A camera whose `pixel_format`, a key of `formats`, determines `bits`."""

    formats: ClassVar[Mapping[str, _PixelDepth]]
    pixel_format: str

    @property
    def _pixel_text(self) -> str:
        return self.pixel_format

    @model_validator(mode="before")
    @classmethod
    def _default_bits(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        default = cls.model_fields["pixel_format"].default
        pixel_format = cls.formats.get(str(values.get("pixel_format", default)))
        return values if pixel_format is None else {"bits": pixel_format.bit_depth} | values

    @field_validator("pixel_format")
    @classmethod
    def _pixel_format_is_known(cls, name: str) -> str:
        if name not in cls.formats:
            raise ValueError(f"{name!r} is unknown; it is one of " + ", ".join(cls.formats))
        return name

    @model_validator(mode="after")
    def _bits_agree_with_the_format(self) -> Self:
        depth = self.formats[self.pixel_format].bit_depth
        if self.bits != depth:
            raise ValueError(
                f"bits = {self.bits}, but pixel_format = {self.pixel_format!r} has {depth}; "
                "leave bits out"
            )
        return self


class DeviceCameraConfig(CameraConfig):
    """A camera that is a device, which cannot see simulated LEDs."""

    device: str = Field(
        min_length=1,
        max_length=4096,
        description="path, name in /dev/v4l/by-id, or number of /dev/video",
    )

    def matches(self, camera: ListedCamera) -> bool:
        """Whether a listed camera is this one."""
        return self.device in (camera.device, *camera.names)


class SimulatedCameraConfig(StampedCameraConfig):
    """The simulated camera above a rendered surface."""

    kind: Literal["simulated"] = "simulated"


class ReplayCameraConfig(StampedCameraConfig):
    """A simulated camera that replays a captured set, in the set's size and depth."""

    kind: Literal["replay"] = "replay"
    set_file: str = Field(
        min_length=1, max_length=4096, description="the set to replay, relative to rig.toml"
    )

    @property
    def recording(self) -> Path:
        return Path(self.set_file)
