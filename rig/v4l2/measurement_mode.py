"""Measurement mode of a V4L2 camera: nothing automatic, and every control read back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from rig.config.camera import V4l2CameraConfig
from rig.errors import CameraError, ControlError, ControlFault

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


def set_measurement_mode(device: V4l2Device, config: V4l2CameraConfig) -> MeasurementMode:
    """Set exposure, switch off what is automatic, set gain and gamma; read all of it back.

    Raises
    ------
    ControlError
        With the names of all controls that are missing, cannot be set or do not hold.
    CameraError
        If the camera is gone or in use.
    """
    settings: list[Setting] = []
    faults: list[ControlFault] = []
    for step in _steps(device, config):
        try:
            settings.append(step())
        except ControlError as error:
            faults += error.faults
    exposures = (s.value for s in settings if s.control.id == abi.CID_EXPOSURE_ABSOLUTE)
    units = next(exposures, config.exposure_ms * EXPOSURE_UNITS_PER_MS)
    mode = MeasurementMode(tuple(settings), units / (1e3 * EXPOSURE_UNITS_PER_MS))
    # One control may move another that was set before it.
    _refuse([*faults, *_moved(device, mode)], device)
    return mode


def check_measurement_mode(device: V4l2Device, mode: MeasurementMode) -> None:
    """Read every control again; raise `ControlError` with the names of all that do not hold."""
    _refuse(_moved(device, mode), device)


def _moved(device: V4l2Device, mode: MeasurementMode) -> list[ControlFault]:
    faults: list[ControlFault] = []
    for setting in mode.settings:
        try:
            check_control(device, setting.control, setting.value)
        except ControlError as error:
            faults += error.faults
    return faults


def _refuse(faults: Sequence[ControlFault], device: V4l2Device) -> None:
    if faults:
        raise ControlError(device.path, *faults)


def _steps(device: V4l2Device, config: V4l2CameraConfig) -> Iterator[Callable[[], Setting]]:
    """What is to be set, in this order, whether or not the step before succeeded."""
    yield from _exposure_steps(device, config)
    for control_id in _AUTOMATIC:
        control = find_control(device, control_id)
        if control is not None and control.is_readable:
            off = 0 if control.minimum <= 0 <= control.maximum else control.minimum
            yield partial(_set, device, control, off)
    # After the automatic ones, which own them while they are on.
    for name, control_id, value in (
        ("gain", abi.CID_GAIN, config.gain),
        ("gamma", abi.CID_GAMMA, config.gamma),
    ):
        if value is not None:
            yield partial(_set_configured, device, name, control_id, value)


def _exposure_steps(
    device: V4l2Device, config: V4l2CameraConfig
) -> Iterator[Callable[[], Setting]]:
    """Manual first: while exposure is automatic, what its time is set to is not defined."""
    if config.fixed_exposure:
        control = find_control(device, abi.CID_EXPOSURE_ABSOLUTE)
        if control is not None:
            raise CameraError(
                f"{device.path}: {device.card} has control {control.slug}, so its exposure is not "
                "fixed; take camera.fixed_exposure away"
            )
        return
    mode = find_control(device, abi.CID_EXPOSURE_AUTO)
    if mode is not None:
        yield partial(_set, device, mode, abi.EXPOSURE_MANUAL)
    yield partial(_set_exposure_time, device, config.exposure_ms)


def _set_exposure_time(device: V4l2Device, exposure_ms: float) -> Setting:
    control = find_control(device, abi.CID_EXPOSURE_ABSOLUTE)
    if control is None:
        raise _missing(
            device,
            "exposure time",
            "if that is always the same, set camera.exposure_ms to it and camera.fixed_exposure = "
            "true",
        )
    units = max(1, round(exposure_ms * EXPOSURE_UNITS_PER_MS))
    if not control.minimum <= units <= control.maximum:
        fault = ControlFault(
            control.slug,
            f"camera.exposure_ms = {exposure_ms:g} is not possible; {control.slug} takes "
            f"{control.minimum / EXPOSURE_UNITS_PER_MS:g} to "
            f"{control.maximum / EXPOSURE_UNITS_PER_MS:g} ms",
            "set camera.exposure_ms within that",
        )
        raise ControlError(device.path, fault)
    return _set_active(device, control, units)


def _set_configured(device: V4l2Device, name: str, control_id: int, value: int) -> Setting:
    control = find_control(device, control_id)
    if control is None:
        raise _missing(device, name, f"take camera.{name} away")
    return _set_active(device, control, value)


def _missing(device: V4l2Device, name: str, advice: str) -> ControlError:
    seen = f"{device.card} has no control for its {name}"
    return ControlError(device.path, ControlFault(name, seen, advice))


def _set_active(device: V4l2Device, control: Control, value: int) -> Setting:
    """Set a control that must have effect."""
    setting = _set(device, control, value)
    after = find_control(device, control.id)
    if after is None or after.is_inactive:
        fault = ControlFault(
            control.slug,
            f"control {control.slug} has no effect, because another control rules it",
            "find out which, and whether the camera can be set by hand at all",
        )
        raise ControlError(device.path, fault)
    return setting


def _set(device: V4l2Device, control: Control, value: int) -> Setting:
    # A read-only control that has the value already is as good as one that took it.
    if not control.is_readable or read_control(device, control) != value:
        write_control(device, control, value)
    return Setting(control, value)
