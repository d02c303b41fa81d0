"""`set_measurement_mode`: nothing of the camera adapts by itself, and every value is read back."""

from typing import Any, ClassVar, Literal

from pydantic import Field

from rig.cameras.config import DeviceCameraConfig, FormattedCameraConfig
from rig.cameras.v4l2.device import RATE_TOLERANCE
from rig.errors import CameraError, ControlError, ControlFault

from .aravis import AravisCamera
from .pixel_formats import PIXEL_FORMATS


class GenicamCameraConfig(DeviceCameraConfig, FormattedCameraConfig):
    """A GigE Vision or USB3 Vision camera; `pixel_format` determines `bits`."""

    formats: ClassVar = PIXEL_FORMATS
    kind: Literal["genicam"] = "genicam"
    device: str = Field(
        min_length=1,
        max_length=200,
        description="id, serial number or IP address",
    )
    pixel_format: str = Field(
        default="Mono8", description="such as Mono12p or BayerRG8; by default Mono8"
    )
    gain: float | None = Field(
        default=None, ge=0.0, le=1e6, description="in the camera's units; else left as it is"
    )
    gamma: float | None = Field(
        default=None, gt=0.0, le=100.0, description="in the camera's units; else left as it is"
    )
    trigger_line: str | None = Field(
        default=None,
        pattern=r"^[A-Za-z]+[0-9]{0,2}$",
        description="input that starts each exposure, such as Line1",
    )


# Sensors take exposures in steps of a row.
_EXPOSURE_TOLERANCE_MS = 0.05
_GAIN_TOLERANCE = 0.1
# What adapts by itself or changes pixels, and its value that does not; names of the SFNC 2.7.
OFF = {
    "ExposureAuto": "Off",
    "GainAuto": "Off",
    "BlackLevelAuto": "Off",
    "BalanceWhiteAuto": "Off",
    "SequencerMode": "Off",
    "TestPattern": "Off",
    "TestImageSelector": "Off",
}
_ONE = ("BinningHorizontal", "BinningVertical", "DecimationHorizontal", "DecimationVertical")


class Settings:
    """Sets features of one camera, and collects those that do not hold."""

    def __init__(self, camera: AravisCamera) -> None:
        self._camera = camera
        self.faults: list[ControlFault] = []

    def hold(self, feature: str, value: int | float | str) -> None:
        """Set a feature and read it back."""
        camera = self._camera
        try:
            camera.set_value(feature, value)
            kind: Any = type(value)
            self.compare(feature, value, camera.value(feature, kind))
        except CameraError as error:
            self.compare(feature, value, str(error))

    def hold_if_there(self, feature: str, value: int | float | str) -> None:
        """Set a feature that not every camera has."""
        if self._camera.has(feature):
            self.hold(feature, value)

    def compare(self, name: str, requested: Any, held: Any, tolerance: float = 0.0) -> None:
        """Add a fault if a value does not hold."""
        if held == requested:
            return
        if isinstance(held, float) and abs(held - requested) <= tolerance:
            return
        self.faults.append(
            ControlFault(
                name,
                f"{name} was set to {requested} and reads {held}",
                "set a value that the camera takes, or leave the key out",
            )
        )


def set_measurement_mode(camera: AravisCamera, config: GenicamCameraConfig) -> float:
    """Set all that `config` states; return the frame period in s.

    Raises a `ControlError` that names every feature that does not hold.
    """
    settings = Settings(camera)
    for feature in _ONE:
        settings.hold_if_there(feature, 1)
    for feature, pixels in (
        ("OffsetX", 0), ("OffsetY", 0), ("Width", config.width_px), ("Height", config.height_px)
    ):  # fmt: skip
        settings.hold(feature, pixels)
    _require_format(camera, config.pixel_format)
    settings.hold("PixelFormat", config.pixel_format)
    for feature, off in OFF.items():
        settings.hold_if_there(feature, off)
    _set_trigger(camera, settings, config.trigger_line)
    period_s = 1.0 / config.frame_rate_hz
    if config.trigger_line is None:
        camera.set_frame_rate(config.frame_rate_hz)
        rate_hz = camera.frame_rate_hz
        tolerance_hz = RATE_TOLERANCE * config.frame_rate_hz
        settings.compare("frame_rate_hz", config.frame_rate_hz, rate_hz, tolerance_hz)
        period_s = 1.0 / rate_hz
    if config.gain is not None:
        camera.set_gain(config.gain)
        settings.compare("gain", config.gain, camera.gain, _GAIN_TOLERANCE)
    if config.gamma is not None:
        settings.hold("Gamma", config.gamma)
    _put_exposure(camera, settings, config.exposure_ms)
    if settings.faults:
        raise ControlError(config.device, *settings.faults)
    return period_s


def set_exposure(camera: AravisCamera, device: str, exposure_ms: float) -> None:
    """Change the exposure; a `ControlError` if the camera does not keep it."""
    settings = Settings(camera)
    _put_exposure(camera, settings, exposure_ms)
    if settings.faults:
        raise ControlError(device, *settings.faults)


def _put_exposure(camera: AravisCamera, settings: Settings, exposure_ms: float) -> None:
    camera.set_exposure(exposure_ms)
    settings.compare("exposure_ms", exposure_ms, camera.exposure_ms, _EXPOSURE_TOLERANCE_MS)


def _require_format(camera: AravisCamera, pixel_format: str) -> None:
    offered = camera.entries("PixelFormat")
    if pixel_format not in offered:
        usable = ", ".join(name for name in offered if name in PIXEL_FORMATS) or "none known here"
        raise CameraError(f"camera.pixel_format = {pixel_format!r}: the camera has {usable}")


def _set_trigger(camera: AravisCamera, settings: Settings, line: str | None) -> None:
    """Let a rising edge at `line` start each exposure; without one the camera runs free."""
    for selector in camera.entries("TriggerSelector") if camera.has("TriggerSelector") else ():
        camera.set_value("TriggerSelector", selector)
        settings.hold("TriggerMode", "Off")
    if line is not None:
        settings.hold("TriggerSelector", "FrameStart")
        settings.hold("TriggerSource", line)
        settings.hold("TriggerActivation", "RisingEdge")
        settings.hold("TriggerMode", "On")
