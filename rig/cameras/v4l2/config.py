"""Configuration of V4L2 cameras, and the keys that OpenCV cameras share with it."""

from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from rig.cameras.camera import ListedCamera
from rig.cameras.config import DeviceCameraConfig, FormattedCameraConfig

from .device import device_path
from .pixel_formats import PIXEL_FORMATS


class VideoCameraConfig(DeviceCameraConfig):
    """A camera at a video device, whose gain and gamma are integers in the driver's units."""

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

    def matches(self, camera: ListedCamera) -> bool:
        """Whether a listed camera is this one, by any of its names."""
        node = Path(device_path(self.device)).resolve()
        return camera.node is not None and camera.node.resolve() == node

    @field_validator("device", mode="before")
    @classmethod
    def _device_may_be_a_number(cls, device: Any) -> Any:
        return str(device) if type(device) is int else device


class V4l2CameraConfig(VideoCameraConfig, FormattedCameraConfig):
    """A V4L2 camera; `pixel_format` is a key of `PIXEL_FORMATS` and determines `bits`."""

    formats: ClassVar = PIXEL_FORMATS
    kind: Literal["v4l2"] = "v4l2"
    pixel_format: str = Field(
        default="GREY",
        description="such as GREY, Y12, SRGGB10 or YUYV; of a genicam camera Mono8 by default",
    )

    @model_validator(mode="after")
    def _pixel_format_can_be_measured(self) -> Self:
        if self.pixel_format == "MJPG" and not self.allow_compressed:
            raise ValueError(
                "pixel_format = 'MJPG' is lossy; choose another, or set allow_compressed = true"
            )
        return self
