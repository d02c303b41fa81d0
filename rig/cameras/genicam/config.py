"""The section ``[camera]`` of ``rig.toml`` for a GenICam camera."""

from typing import ClassVar, Literal

from pydantic import Field

from rig.cameras.config import DeviceCameraConfig, FormattedCameraConfig

from .pixel_formats import PIXEL_FORMATS


class GenicamCameraConfig(DeviceCameraConfig, FormattedCameraConfig):
    """A GigE Vision or USB3 Vision camera; `pixel_format` determines `bits`."""

    formats: ClassVar = PIXEL_FORMATS
    kind: Literal["genicam"] = "genicam"
    device: str = Field(
        min_length=1,
        max_length=200,
        description="of a genicam camera its id, serial number or IP address",
    )
    pixel_format: str = Field(default="Mono8", description="such as Mono12p or BayerRG8")
    gain: float | None = Field(
        default=None, ge=0.0, le=1e6, description="in the camera's units; else left as it is"
    )
    gamma: float | None = Field(
        default=None, gt=0.0, le=100.0, description="in the camera's units; else left as it is"
    )
    trigger_line: str | None = Field(
        default=None,
        pattern=r"^[A-Za-z]+[0-9]{0,2}$",
        description="input of a genicam camera that starts each exposure, such as Line1",
    )
