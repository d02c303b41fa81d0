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
# What adapts by itself or changes frames, and its value that does not: names of the SFNC 2.7, and
# older or own ones of Basler, FLIR and Hikrobot.
HELD: dict[str, bool | str] = {
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
_UNIT_FEATURES = (
    "BinningHorizontal", "BinningVertical", "DecimationHorizontal", "DecimationVertical",
    "AcquisitionBurstFrameCount",
)  # fmt: skip
# The trigger of one frame, best first: some cameras of Hikrobot have a burst of one frame only.
_FRAME_TRIGGERS = ("FrameStart", "FrameBurstStart", "AcquisitionStart")
_RATE_LIMITS = ("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled")
# The rate that exposure, readout and line allow, by Basler, Hikrobot and FLIR.
_REACHED_RATES = (
    "ResultingFrameRate", "ResultingFrameRateAbs", "BslResultingAcquisitionFrameRate",
    "AcquisitionResultingFrameRate",
)  # fmt: skip
GAMMA_SWITCHES = ("GammaEnable", "GammaEnabled")
# Of a number in a register of 32 bits.
_RELATIVE_TOLERANCE = 1e-5


class Settings:
    """Sets features of one camera, and collects those that do not hold."""

    def __init__(self, camera: AravisCamera) -> None:
        self._camera = camera
        self.faults: list[ControlFault] = []

    def hold(self, feature: str, value: bool | int | float | str) -> None:
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

    def hold_if_there(self, feature: str, value: bool | int | float | str) -> None:
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
    """Set all that `config` states; return the frame period in s, or name every feature that does
    not hold in a `ControlError`.
    """
    settings = Settings(camera)
    for feature, value in HELD.items():
        settings.hold_if_there(feature, value)
    for feature in _UNIT_FEATURES:
        settings.hold_if_there(feature, 1)
    for feature, pixels in (
        ("OffsetX", 0), ("OffsetY", 0), ("Width", config.width_px), ("Height", config.height_px)
    ):  # fmt: skip
        settings.hold(feature, pixels)
    _require_format(camera, config.pixel_format)
    settings.hold("PixelFormat", config.pixel_format)
    _set_trigger(camera, settings, config.trigger_line)
    # The present exposure may be too long for the rate, and the present rate for the exposure.
    camera.set_exposure(min(config.exposure_ms, camera.exposure_range_ms[1]))
    for switch in _RATE_LIMITS:
        settings.hold_if_there(switch, config.trigger_line is None)
    if config.trigger_line is None:
        camera.set_frame_rate(config.frame_rate_hz)
    if config.gain is not None:
        camera.set_gain(config.gain)
        settings.compare("gain", config.gain, camera.gain, _GAIN_TOLERANCE)
    if config.gamma is not None:
        settings.hold_if_there("GammaSelector", "User")
        for switch in GAMMA_SWITCHES:
            settings.hold_if_there(switch, True)
        settings.hold("Gamma", config.gamma)
    rate_hz = _put_exposure(camera, settings, config, config.exposure_ms)
    if settings.faults:
        raise ControlError(config.device, *settings.faults)
    return 1.0 / rate_hz


def set_exposure(camera: AravisCamera, config: GenicamCameraConfig, exposure_ms: float) -> None:
    """Change the exposure; a `ControlError` if the camera does not keep it, or its rate."""
    settings = Settings(camera)
    _put_exposure(camera, settings, config, exposure_ms)
    if settings.faults:
        raise ControlError(config.device, *settings.faults)


def _put_exposure(
    camera: AravisCamera, settings: Settings, config: GenicamCameraConfig, exposure_ms: float
) -> float:
    """Set the exposure; return the frame rate, which some cameras lower for it."""
    camera.set_exposure(exposure_ms)
    settings.compare("exposure_ms", exposure_ms, camera.exposure_ms, _EXPOSURE_TOLERANCE_MS)
    asked_hz = config.frame_rate_hz
    rate_hz = asked_hz if config.trigger_line is not None else camera.frame_rate_hz
    reached_hz = [camera.number(name) for name in _REACHED_RATES if camera.has(name)]
    settings.compare(
        "frame_rate_hz", asked_hz, min([rate_hz, *reached_hz]), RATE_TOLERANCE * asked_hz
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
        settings.hold_if_there("TriggerMode", "Off")
    settings.hold_if_there("TriggerMode", "Off")
    if line is not None:
        for selector in [name for name in _FRAME_TRIGGERS if name in selectors][:1]:
            settings.hold("TriggerSelector", selector)
        settings.hold("TriggerSource", line)
        settings.hold_if_there("TriggerActivation", "RisingEdge")
        settings.hold("TriggerMode", "On")
