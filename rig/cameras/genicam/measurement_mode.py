"""`set_measurement_mode`: nothing of the camera adapts by itself, and every value is read back."""

from typing import Any, ClassVar, Literal

from pydantic import Field

from rig.cameras.config import DeviceCameraConfig, FormattedCameraConfig
from rig.cameras.v4l2.device import RATE_TOLERANCE
from rig.errors import CameraError, CameraFault, ControlError

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
# Features that adapt by themselves or change frames, and the values that switch this off. The names
# are those of the SFNC 2.7, and older ones or own ones of Basler, FLIR and Hikrobot.
FIXED_FEATURES: dict[str, bool | str] = {
    "SequencerMode": "Off",
    "SequenceEnable": False,
    "AcquisitionMode": "Continuous",
    "ExposureMode": "Timed",
    "ExposureAuto": "Off",
    "GainAuto": "Off",
    "BlackLevelAuto": "Off",
    "BalanceWhiteAuto": "Off",
    "BslColorSpace": "Off",
    "TestPattern": "Off",
    "TestImageSelector": "Off",
    "HDREnable": False,
    "LUTEnable": False,
    "SharpeningEnable": False,
    "SharpnessEnable": False,
    "SharpnessEnabled": False,
    "ChunkModeActive": False,
}
# Features that must be 1.
_UNIT_FEATURES = (
    "BinningHorizontal", "BinningVertical", "DecimationHorizontal", "DecimationVertical",
    "AcquisitionBurstFrameCount",
)  # fmt: skip
# The trigger of one frame, best first: some cameras of Hikrobot have a burst of one frame only.
_FRAME_TRIGGERS = ("FrameStart", "FrameBurstStart", "AcquisitionStart")
_RATE_LIMITS = ("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled")
# Features with the rate that exposure, readout and link allow, of Basler, Hikrobot and FLIR.
_REACHED_RATES = (
    "ResultingFrameRate", "ResultingFrameRateAbs", "BslResultingAcquisitionFrameRate",
    "AcquisitionResultingFrameRate",
)  # fmt: skip
GAMMA_SWITCHES = ("GammaEnable", "GammaEnabled")
# Tolerance of a value that the camera holds as a float of 32 bits.
_RELATIVE_TOLERANCE = 1e-5


class Settings:
    """Sets features of one camera, and collects those that do not keep the value."""

    def __init__(self, camera: AravisCamera) -> None:
        self._camera = camera
        self.faults: list[CameraFault] = []

    def set(self, feature: str, value: bool | int | float | str) -> None:
        """Set a feature, unless it has the value already, and read it back."""
        camera = self._camera
        kind: Any = type(value)
        tolerance = _RELATIVE_TOLERANCE * value if isinstance(value, float) else 0.0
        try:
            if camera.value(feature, kind) != value:  # it may be read-only
                camera.set_value(feature, value)
            self.compare(feature, value, camera.value(feature, kind), tolerance)
        except CameraError as error:
            self.compare(feature, value, str(error))

    def set_if_available(self, feature: str, value: bool | int | float | str) -> None:
        """Set a feature that not every camera has."""
        if self._camera.has(feature):
            self.set(feature, value)

    def compare(self, name: str, requested: Any, actual: Any, tolerance: float = 0.0) -> None:
        """Add a fault if the camera does not have the requested value."""
        if actual == requested:
            return
        if isinstance(actual, float) and abs(actual - requested) <= tolerance:
            return
        self.faults.append(
            CameraFault(
                name,
                f"{name} was set to {requested} and reads {actual}",
                "set a value that the camera takes, or leave the key out",
            )
        )


def set_measurement_mode(camera: AravisCamera, config: GenicamCameraConfig) -> float:
    """Set all that `config` states, and return the frame period in s.

    A `ControlError` names every feature that does not keep its value.
    """
    settings = Settings(camera)
    for feature, value in FIXED_FEATURES.items():
        settings.set_if_available(feature, value)
    for feature in _UNIT_FEATURES:
        settings.set_if_available(feature, 1)
    for feature, pixels in (
        ("OffsetX", 0), ("OffsetY", 0), ("Width", config.width_px), ("Height", config.height_px)
    ):  # fmt: skip
        settings.set(feature, pixels)
    _require_format(camera, config.pixel_format)
    settings.set("PixelFormat", config.pixel_format)
    _set_trigger(camera, settings, config.trigger_line)
    # Exposure and rate limit each other: the exposure is set before the rate and again after it.
    camera.set_exposure(min(config.exposure_ms, camera.exposure_range_ms[1]))
    for switch in _RATE_LIMITS:
        settings.set_if_available(switch, config.trigger_line is None)
    if config.trigger_line is None:
        camera.set_frame_rate(config.frame_rate_hz)
    if config.gain is not None:
        camera.set_gain(config.gain)
        settings.compare("gain", config.gain, camera.gain, _GAIN_TOLERANCE)
    if config.gamma is not None:
        settings.set_if_available("GammaSelector", "User")
        for switch in GAMMA_SWITCHES:
            settings.set_if_available(switch, True)
        settings.set("Gamma", config.gamma)
    rate_hz = _apply_exposure(camera, settings, config, config.exposure_ms)
    if settings.faults:
        raise ControlError(config.device, *settings.faults)
    return 1.0 / rate_hz


def set_exposure(camera: AravisCamera, config: GenicamCameraConfig, exposure_ms: float) -> None:
    """Change the exposure; a `ControlError` if the camera does not keep it, or its rate."""
    settings = Settings(camera)
    _apply_exposure(camera, settings, config, exposure_ms)
    if settings.faults:
        raise ControlError(config.device, *settings.faults)


def _apply_exposure(
    camera: AravisCamera, settings: Settings, config: GenicamCameraConfig, exposure_ms: float
) -> float:
    """Set the exposure; return the frame rate, which some cameras lower for it."""
    camera.set_exposure(exposure_ms)
    settings.compare("exposure_ms", exposure_ms, camera.exposure_ms, _EXPOSURE_TOLERANCE_MS)
    requested_hz = config.frame_rate_hz
    rate_hz = requested_hz if config.trigger_line is not None else camera.frame_rate_hz
    reached_hz = [camera.number(name) for name in _REACHED_RATES if camera.has(name)]
    settings.compare(
        "frame_rate_hz", requested_hz, min([rate_hz, *reached_hz]), RATE_TOLERANCE * requested_hz
    )
    return rate_hz


def _require_format(camera: AravisCamera, pixel_format: str) -> None:
    offered = camera.entries("PixelFormat")
    if pixel_format not in offered:
        usable = ", ".join(name for name in offered if name in PIXEL_FORMATS) or "none known here"
        raise CameraError(f"camera.pixel_format = {pixel_format!r}: the camera has {usable}")


def _set_trigger(camera: AravisCamera, settings: Settings, line: str | None) -> None:
    """Let a rising edge at `line` start each exposure; without one the camera runs free."""
    selectors = camera.entries("TriggerSelector") if camera.has("TriggerSelector") else []
    for selector in selectors:
        camera.set_value("TriggerSelector", selector)
        settings.set_if_available("TriggerMode", "Off")
    settings.set_if_available("TriggerMode", "Off")
    if line is not None:
        frame_trigger = next((name for name in _FRAME_TRIGGERS if name in selectors), None)
        if frame_trigger is not None:
            settings.set("TriggerSelector", frame_trigger)
        settings.set("TriggerSource", line)
        settings.set_if_available("TriggerActivation", "RisingEdge")
        settings.set("TriggerMode", "On")
