"""Measurement mode of a V4L2 camera: nothing automatic, and every control read back."""

from __future__ import annotations

from dataclasses import dataclass

from rig.config import CameraConfig
from rig.errors import CameraError

from . import abi
from .controls import Control, check_control, find_control, read_control, write_control
from .device import V4l2Device

__all__ = ["MeasurementMode", "Setting", "check_measurement_mode", "set_measurement_mode"]

# ``EXPOSURE_ABSOLUTE`` counts 100 us.
EXPOSURE_UNITS_PER_MS = 10
# Off is 0, or the minimum where 0 is not allowed.
_AUTOMATIC = (
    abi.CID_AUTOGAIN,
    abi.CID_AUTO_WHITE_BALANCE,
    abi.CID_AUTO_N_PRESET_WHITE_BALANCE,
    abi.CID_FOCUS_AUTO,
    abi.CID_EXPOSURE_AUTO_PRIORITY,
    abi.CID_BACKLIGHT_COMPENSATION,
    abi.CID_HUE_AUTO,
    abi.CID_AUTOBRIGHTNESS,
    abi.CID_ISO_SENSITIVITY_AUTO,
    abi.CID_WIDE_DYNAMIC_RANGE,
    abi.CID_IMAGE_STABILIZATION,
    abi.CID_SHARPNESS,
)


@dataclass(frozen=True)
class Setting:
    """A control and the value that it must keep."""

    control: Control
    value: int


@dataclass(frozen=True)
class MeasurementMode:
    """What was set, and the exposure time that came of it."""

    settings: tuple[Setting, ...]
    exposure_s: float


def set_measurement_mode(device: V4l2Device, config: CameraConfig) -> MeasurementMode:
    """Set exposure, switch off what is automatic, set gain and gamma; read all of it back.

    Raises
    ------
    CameraError
        With the control's name, if one is missing, cannot be set or does not hold.
    """
    settings = _exposure(device, config)
    exposure_s = config.exposure_ms / 1e3
    if settings:
        exposure_s = settings[-1].value / (1e3 * EXPOSURE_UNITS_PER_MS)
    for control_id in _AUTOMATIC:
        control = find_control(device, control_id)
        if control is not None and control.is_readable:
            off = 0 if control.minimum <= 0 <= control.maximum else control.minimum
            settings.append(_set(device, control, off))
    # After the automatic ones, which own them while they are on.
    for name, control_id, value in (
        ("gain", abi.CID_GAIN, config.gain),
        ("gamma", abi.CID_GAMMA, config.gamma),
    ):
        if value is not None:
            settings.append(_set_active(device, name, control_id, value))
    mode = MeasurementMode(tuple(settings), exposure_s)
    # One control may move another that was set before it.
    check_measurement_mode(device, mode)
    return mode


def check_measurement_mode(device: V4l2Device, mode: MeasurementMode) -> None:
    """Read every control again; raise `CameraError` with the name of one that does not hold."""
    for setting in mode.settings:
        check_control(device, setting.control, setting.value)


def _exposure(device: V4l2Device, config: CameraConfig) -> list[Setting]:
    """Manual first: while exposure is automatic, what its time is set to is not defined."""
    control = find_control(device, abi.CID_EXPOSURE_ABSOLUTE)
    if config.fixed_exposure:
        if control is not None:
            raise CameraError(
                f"{device.path}: {device.card} has control {control.slug}, so its exposure is not "
                "fixed; take camera.fixed_exposure away"
            )
        return []
    if control is None:
        raise CameraError(
            f"{device.path}: {device.card} has no control for its exposure time; if that is always "
            "the same, set camera.exposure_ms to it and camera.fixed_exposure = true"
        )
    settings = []
    mode = find_control(device, abi.CID_EXPOSURE_AUTO)
    if mode is not None:
        settings.append(_set(device, mode, abi.EXPOSURE_MANUAL))
    units = max(1, round(config.exposure_ms * EXPOSURE_UNITS_PER_MS))
    if not control.minimum <= units <= control.maximum:
        raise CameraError(
            f"{device.path}: camera.exposure_ms = {config.exposure_ms:g} is not possible; "
            f"{control.slug} takes {control.minimum / EXPOSURE_UNITS_PER_MS:g} to "
            f"{control.maximum / EXPOSURE_UNITS_PER_MS:g} ms"
        )
    settings.append(_set_active(device, "exposure time", control.id, units))
    return settings


def _set_active(device: V4l2Device, name: str, control_id: int, value: int) -> Setting:
    """Set a control that must be there and have effect."""
    control = find_control(device, control_id)
    if control is None:
        raise CameraError(f"{device.path}: {device.card} has no control for its {name}")
    setting = _set(device, control, value)
    after = find_control(device, control_id)
    if after is None or after.is_inactive:
        raise CameraError(
            f"{device.path}: control {control.slug} has no effect, because another control rules "
            "it; find out which, and whether the camera can be set by hand at all"
        )
    return setting


def _set(device: V4l2Device, control: Control, value: int) -> Setting:
    # A read-only control that has the value already is as good as one that took it.
    if not control.is_readable or read_control(device, control) != value:
        write_control(device, control, value)
    return Setting(control, value)
