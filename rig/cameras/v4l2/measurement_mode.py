"""Measurement mode of a V4L2 camera: nothing automatic, every control read back."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from rig.cameras.camera import ListedCamera
from rig.cameras.config import DeviceCameraConfig, FormattedCameraConfig
from rig.errors import CameraError, CameraFault, ControlError

from . import abi
from .controls import Control, check_control, find_control, read_control, write_control
from .device import V4l2Device, device_path
from .pixel_formats import PIXEL_FORMATS


class VideoCameraConfig(DeviceCameraConfig):
    """A camera at a video device, whose gain and gamma are integers in the driver's units."""

    allow_compressed: bool = Field(default=False, description="MJPG may be used")
    fixed_exposure: bool = Field(
        default=False, description="the camera has no control of the exposure"
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
    pixel_format: str = Field(default="GREY", description="such as GREY, Y12, SRGGB10 or YUYV")

    @model_validator(mode="after")
    def _pixel_format_can_be_measured(self) -> Self:
        if self.pixel_format == "MJPG" and not self.allow_compressed:
            raise ValueError(
                "pixel_format = 'MJPG' is lossy; choose another, or set allow_compressed = true"
            )
        return self


EXPOSURE_UNITS_PER_MS = 10
"""``EXPOSURE_ABSOLUTE`` counts units of 100 us."""
# Controls that are set to 0, or to their minimum if 0 is not allowed.
_AUTOMATIC = (
    abi.Cid.AUTOGAIN,
    abi.Cid.AUTO_WHITE_BALANCE,
    abi.Cid.AUTO_N_PRESET_WHITE_BALANCE,
    abi.Cid.FOCUS_AUTO,
    abi.Cid.EXPOSURE_AUTO_PRIORITY,
    abi.Cid.BACKLIGHT_COMPENSATION,
    abi.Cid.HUE_AUTO,
    abi.Cid.AUTOBRIGHTNESS,
    abi.Cid.ISO_SENSITIVITY_AUTO,
    abi.Cid.WIDE_DYNAMIC_RANGE,
    abi.Cid.IMAGE_STABILIZATION,
    abi.Cid.SHARPNESS,
)
# Controls that change the pixel value of the same light.
_PIXEL_VALUE_CONTROLS = {
    abi.Cid.GAIN: "gain",
    abi.Cid.GAMMA: "gamma",
    abi.Cid.BRIGHTNESS: "brightness",
    abi.Cid.CONTRAST: "contrast",
    abi.Cid.BLACK_LEVEL: "black_level",
    abi.Cid.RED_BALANCE: "red_balance",
    abi.Cid.BLUE_BALANCE: "blue_balance",
    abi.Cid.WHITE_BALANCE_TEMPERATURE: "white_balance_temperature",
    abi.Cid.BACKLIGHT_COMPENSATION: "backlight_compensation",
    abi.Cid.ISO_SENSITIVITY: "iso_sensitivity",
    abi.Cid.ANALOGUE_GAIN: "analogue_gain",
    abi.Cid.DIGITAL_GAIN: "digital_gain",
}


_Setting = tuple[Control, int]


@dataclass(frozen=True)
class _Mode:
    """Controls with the values that they must keep, and the exposure time."""

    settings: tuple[_Setting, ...]
    exposure_s: float


def set_measurement_mode(device: V4l2Device, config: V4l2CameraConfig) -> _Mode:
    """Set exposure, gain and gamma, turn off automatic controls, read all back."""
    settings: list[_Setting] = []
    faults: list[CameraFault] = []

    def attempt(set_control: Callable[..., _Setting], *arguments: Any) -> None:
        """Set one control; a failure does not prevent the next."""
        try:
            settings.append(set_control(device, *arguments))
        except ControlError as error:
            faults.extend(error.faults)

    if config.fixed_exposure:
        _require_no_exposure_control(device)
    else:
        # Manual mode is set first. Without it, setting the time has no defined effect.
        if (mode_control := find_control(device, abi.Cid.EXPOSURE_AUTO)) is not None:
            attempt(_set, mode_control, abi.EXPOSURE_MANUAL)
        attempt(_set_exposure_time, config.exposure_ms)
    for control_id in _AUTOMATIC:
        control = find_control(device, control_id)
        if control is not None and control.is_readable:
            off = 0 if control.minimum <= 0 <= control.maximum else control.minimum
            attempt(_set, control, off)
    # After the automatic controls, which override them.
    if config.gain is not None:
        attempt(_set_configured, "gain", abi.Cid.GAIN, config.gain)
    if config.gamma is not None:
        attempt(_set_configured, "gamma", abi.Cid.GAMMA, config.gamma)
    exposures = (value for control, value in settings if control.id == abi.Cid.EXPOSURE_ABSOLUTE)
    units = next(exposures, config.exposure_ms * EXPOSURE_UNITS_PER_MS)
    mode = _Mode(tuple(settings), units / (1e3 * EXPOSURE_UNITS_PER_MS))
    # Setting one control may change another that was set before.
    faults += _changed_controls(device, mode)
    if faults:
        raise ControlError(device.path, *faults)
    return mode


def pixel_values(device: V4l2Device) -> dict[str, Any]:
    """Read gain, gamma and the other controls of pixel values, as in `CameraInfo`."""
    values: dict[str, float] = {}
    for control_id, name in _PIXEL_VALUE_CONTROLS.items():
        control = find_control(device, control_id)
        if control is not None and control.is_readable:
            values[name] = float(read_control(device, control))
    gain_and_gamma = {name: values.pop(name, None) for name in ("gain", "gamma")}
    return {**gain_and_gamma, "pixel_value_controls": values}


def exposure_range_ms(device: V4l2Device, config: V4l2CameraConfig) -> tuple[float, float]:
    """Shortest and longest exposure of the camera; the same if its exposure is fixed."""
    control = None if config.fixed_exposure else find_control(device, abi.Cid.EXPOSURE_ABSOLUTE)
    if control is None:
        return config.exposure_ms, config.exposure_ms
    shortest, longest = max(1, control.minimum), control.maximum
    return shortest / EXPOSURE_UNITS_PER_MS, longest / EXPOSURE_UNITS_PER_MS


def set_exposure(device: V4l2Device, mode: _Mode, exposure_ms: float) -> _Mode:
    """Change the exposure of a streaming camera, and read every control back."""
    control, units = _set_exposure_time(device, exposure_ms)
    others = tuple(setting for setting in mode.settings if setting[0].id != control.id)
    changed = _Mode((*others, (control, units)), units / (1e3 * EXPOSURE_UNITS_PER_MS))
    check_measurement_mode(device, changed)
    return changed


def check_measurement_mode(device: V4l2Device, mode: _Mode) -> None:
    """Read every control again; raise a `ControlError` that names all that changed."""
    if faults := _changed_controls(device, mode):
        raise ControlError(device.path, *faults)


def _changed_controls(device: V4l2Device, mode: _Mode) -> list[CameraFault]:
    faults: list[CameraFault] = []
    for control, value in mode.settings:
        try:
            check_control(device, control, value)
        except ControlError as error:
            faults += error.faults
    return faults


def _require_no_exposure_control(device: V4l2Device) -> None:
    control = find_control(device, abi.Cid.EXPOSURE_ABSOLUTE)
    if control is not None:
        raise CameraError(
            f"{device.path}: {device.card} has control {control.slug}, so its exposure is not "
            "fixed; remove camera.fixed_exposure"
        )


def _set_exposure_time(device: V4l2Device, exposure_ms: float) -> _Setting:
    control = find_control(device, abi.Cid.EXPOSURE_ABSOLUTE)
    if control is None:
        raise _missing(
            device,
            "exposure time",
            "if its exposure never changes, set camera.exposure_ms to it and "
            "camera.fixed_exposure = true",
        )
    units = max(1, round(exposure_ms * EXPOSURE_UNITS_PER_MS))
    if not control.minimum <= units <= control.maximum:
        fault = CameraFault(
            control.slug,
            f"camera.exposure_ms = {exposure_ms:g} is not possible; {control.slug} takes "
            f"{control.minimum / EXPOSURE_UNITS_PER_MS:g} to "
            f"{control.maximum / EXPOSURE_UNITS_PER_MS:g} ms",
            "set camera.exposure_ms within that range",
        )
        raise ControlError(device.path, fault)
    return _set_active(device, control, units)


def _set_configured(device: V4l2Device, name: str, control_id: int, value: int) -> _Setting:
    control = find_control(device, control_id)
    if control is None:
        raise _missing(device, name, f"remove camera.{name}")
    return _set_active(device, control, value)


def _missing(device: V4l2Device, name: str, advice: str) -> ControlError:
    finding = f"{device.card} has no control for its {name}"
    return ControlError(device.path, CameraFault(name, finding, advice))


def _set_active(device: V4l2Device, control: Control, value: int) -> _Setting:
    """Set a control, and check that no other one overrides it."""
    setting = _set(device, control, value)
    control_after = find_control(device, control.id)
    if control_after is None or control_after.flags & abi.CtrlFlag.INACTIVE:
        fault = CameraFault(
            control.slug,
            f"control {control.slug} has no effect, because another control overrides it",
            "turn off the other control; v4l2-ctl -l lists the camera's controls",
        )
        raise ControlError(device.path, fault)
    return setting


def _set(device: V4l2Device, control: Control, value: int) -> _Setting:
    # A read-only control may have the value already.
    if not control.is_readable or read_control(device, control) != value:
        write_control(device, control, value)
    return control, value
