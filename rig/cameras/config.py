"""The section ``[camera]`` of ``rig.toml``: one class per kind of camera."""

from typing import (
    Annotated,
    Any,
    Literal,
    Self,
)

from pydantic import Field, field_validator, model_validator

from classify.base.section import Section

# Pixel formats by name with their true depth. `v4l2.pixel_formats` decodes them; it is not
# imported here, so that a configuration is read without loading OpenCV.
PIXEL_FORMAT_BITS = {
    "GREY": 8,
    "Y10": 10,
    "Y12": 12,
    "Y16": 16,
    "YUYV": 8,
    "UYVY": 8,
    "RGB24": 8,
    "BGR24": 8,
    "MJPG": 8,
    **{
        f"{order}{bits}": bits
        for order in ("SRGGB", "SGRBG", "SGBRG", "SBGGR")
        for bits in (8, 10, 12)
    },
}


class CameraConfig(Section):
    """The keys of every kind of camera."""

    kind: str = Field(description="simulated by default with simulated lights, else v4l2")
    width_px: int = Field(default=512, ge=16, le=8192, description="of the frame")
    height_px: int = Field(default=512, ge=16, le=8192, description="of the frame")
    bits: Literal[8, 10, 12, 16] = Field(
        default=12, description="of a pixel; of a v4l2 camera those of pixel_format"
    )
    frame_rate_hz: float = Field(default=30.0, ge=0.1, le=1000.0, description="frames per second")
    exposure_ms: float = Field(
        default=20.0, gt=0.0, le=10_000.0, description="at most a frame period"
    )

    @property
    def mode(self) -> str:
        """The settings that determine the frame timing, as text."""
        return (
            f"{self._pixels} {self.width_px}x{self.height_px}, {self.frame_rate_hz:g} Hz, "
            f"{self.exposure_ms:g} ms"
        )

    @property
    def _pixels(self) -> str:
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
        description="event of a stamp: frame_end by default; the one that the driver announces, by "
        "default if simulated; or that of the writer of a loopback device",
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
        description="mode for which the timing holds; the camera is not opened in another",
    )

    @property
    def believes_driver(self) -> bool:
        """Whether a driver that claims to stamp the start of exposure is believed."""
        if self.timestamp_marks is None:
            return self.kind in ("simulated", "replay")
        return self.timestamp_marks == "driver"

    @model_validator(mode="after")
    def _readout_fits(self) -> Self:
        if self.readout_ms is not None:
            self._require_within_frame("readout_ms", self.readout_ms)
        return self


class DeviceCameraConfig(CameraConfig):
    """A camera that is a device of this machine."""

    device: str = Field(
        min_length=1,
        max_length=4096,
        description="path, name in /dev/v4l/by-id, or number of /dev/video",
    )
    allow_compressed: bool = Field(default=False, description="MJPG may be used")
    fixed_exposure: bool = Field(
        default=False, description="the camera always exposes for exposure_ms and has no control"
    )
    gain: int | None = Field(
        default=None, ge=0, le=2**31 - 1, description="in the camera's units; else left as it is"
    )
    gamma: int | None = Field(
        default=None, ge=0, le=2**31 - 1, description="in the camera's units; else left as it is"
    )

    @field_validator("device", mode="before")
    @classmethod
    def _device_may_be_a_number(cls, device: Any) -> Any:
        return str(device) if type(device) is int else device


class SimulatedCameraConfig(StampedCameraConfig):
    """The simulated camera above a rendered surface."""

    kind: Literal["simulated"] = "simulated"


class ReplayCameraConfig(StampedCameraConfig):
    """A simulated camera that replays a captured set, in the set's size and depth."""

    kind: Literal["replay"] = "replay"
    set_file: str = Field(
        min_length=1, max_length=4096, description="the set to replay, relative to rig.toml"
    )


class OpencvCameraConfig(DeviceCameraConfig):
    """A camera through OpenCV; `rig.cameras.opencv.OpencvCamera` lists its limitations."""

    kind: Literal["opencv"] = "opencv"
    bits: Literal[8] = 8


class V4l2CameraConfig(DeviceCameraConfig, StampedCameraConfig):
    """A V4L2 camera; `pixel_format` is a key of `PIXEL_FORMAT_BITS` and determines `bits`."""

    kind: Literal["v4l2"] = "v4l2"
    pixel_format: str = Field(default="GREY", description="such as GREY, Y12, SRGGB10 or YUYV")

    @property
    def _pixels(self) -> str:
        return self.pixel_format

    @model_validator(mode="before")
    @classmethod
    def _bits_of_the_format(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        bits = PIXEL_FORMAT_BITS.get(str(values.get("pixel_format", "GREY")))
        return {"bits": bits} | values if bits is not None else values

    @field_validator("pixel_format")
    @classmethod
    def _pixel_format_is_known(cls, name: str) -> str:
        if name not in PIXEL_FORMAT_BITS:
            raise ValueError(f"{name!r} is unknown; it is one of " + ", ".join(PIXEL_FORMAT_BITS))
        return name

    @model_validator(mode="after")
    def _pixel_format_can_be_measured(self) -> Self:
        depth = PIXEL_FORMAT_BITS[self.pixel_format]
        if self.bits != depth:
            raise ValueError(
                f"bits = {self.bits}, but pixel_format = {self.pixel_format!r} has {depth}; "
                "leave bits out"
            )
        if self.pixel_format == "MJPG" and not self.allow_compressed:
            raise ValueError(
                "pixel_format = 'MJPG' is lossy; choose another, or set allow_compressed = true"
            )
        return self


AnyCameraConfig = Annotated[
    SimulatedCameraConfig | ReplayCameraConfig | OpencvCameraConfig | V4l2CameraConfig,
    Field(discriminator="kind"),
]
CAMERA_KINDS: dict[str, type[CameraConfig]] = {
    "simulated": SimulatedCameraConfig,
    "v4l2": V4l2CameraConfig,
    "opencv": OpencvCameraConfig,
    "replay": ReplayCameraConfig,
}


def without_idle_keys(values: dict[str, Any]) -> dict[str, Any]:
    """Drop the keys of other kinds that have their default, so that a file may list every key."""
    fields = {
        name: field for model in CAMERA_KINDS.values() for name, field in model.model_fields.items()
    }
    own = CAMERA_KINDS.get(str(values["kind"]), CameraConfig).model_fields
    return {
        key: value
        for key, value in values.items()
        if key in own or key not in fields or value != fields[key].default
    }
