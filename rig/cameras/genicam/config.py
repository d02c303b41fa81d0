"""The section ``[camera]`` of ``rig.toml`` for a GenICam camera."""

from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from rig.cameras.config import DeviceCameraConfig, StampedCameraConfig

from .pixel_formats import PIXEL_FORMATS


class GenicamCameraConfig(DeviceCameraConfig, StampedCameraConfig):
    """A GigE Vision or USB3 Vision camera; `pixel_format` determines `bits`."""

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

    @property
    def _pixels(self) -> str:
        return self.pixel_format

    @model_validator(mode="before")
    @classmethod
    def _bits_of_the_format(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        pixel_format = PIXEL_FORMATS.get(str(values.get("pixel_format", "Mono8")))
        return values if pixel_format is None else {"bits": pixel_format.bit_depth} | values

    @field_validator("pixel_format")
    @classmethod
    def _pixel_format_is_known(cls, name: str) -> str:
        if name not in PIXEL_FORMATS:
            raise ValueError(f"{name!r} is unknown; it is one of " + ", ".join(PIXEL_FORMATS))
        return name

    @model_validator(mode="after")
    def _bits_are_those_of_the_format(self) -> Self:
        depth = PIXEL_FORMATS[self.pixel_format].bit_depth
        if self.bits != depth:
            raise ValueError(
                f"bits = {self.bits}, but pixel_format = {self.pixel_format!r} has {depth}; "
                "leave bits out"
            )
        return self
