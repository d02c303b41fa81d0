"""Measurement mode on cameras with exposure controls, which the kernel's test driver lacks.

A fake camera answers the ioctls as UVC cameras do.
"""

import errno
from dataclasses import dataclass, field
from typing import Any

import pytest

from rig import CameraError
from rig.cameras.v4l2 import abi
from rig.cameras.v4l2.controls import list_controls
from rig.cameras.v4l2.device import V4l2Device, VideoFormat
from rig.cameras.v4l2.measurement_mode import (
    V4l2CameraConfig,
    check_measurement_mode,
    exposure_range_ms,
    set_exposure,
    set_measurement_mode,
)
from rig.doctor.devices import check_controls
from rig.errors import ControlError

AUTO, TIME = abi.Cid.EXPOSURE_AUTO, abi.Cid.EXPOSURE_ABSOLUTE
PRIORITY = abi.Cid.EXPOSURE_AUTO_PRIORITY
APERTURE_PRIORITY = 3


@dataclass
class Knob:
    name: str
    value: int
    minimum: int = 0
    maximum: int = 1
    menu: dict[int, str] = field(default_factory=dict)
    flags: int = 0
    # Accepts every value without an error, and keeps its own.
    stubborn: bool = False


def usual_knobs() -> dict[int, Knob]:
    modes = {abi.EXPOSURE_MANUAL: "Manual Mode", APERTURE_PRIORITY: "Aperture Priority Mode"}
    return {
        AUTO: Knob("Auto Exposure", APERTURE_PRIORITY, 0, 3, modes),
        TIME: Knob("Exposure Time, Absolute", 157, 3, 2047),
        PRIORITY: Knob("Exposure, Dynamic Framerate", 1),
        abi.Cid.AUTO_WHITE_BALANCE: Knob("White Balance, Automatic", 1),
        abi.Cid.FOCUS_AUTO: Knob("Focus, Automatic Continuous", 1),
        abi.Cid.BACKLIGHT_COMPENSATION: Knob("Backlight Compensation", 2, 0, 2),
        abi.Cid.SHARPNESS: Knob("Sharpness", 5, 1, 7),
        abi.Cid.GAIN: Knob("Gain", 64, 0, 255),
        abi.Cid.GAMMA: Knob("Gamma", 100, 72, 500),
    }


class FakeCamera(V4l2Device):
    """Answers the control ioctls as a driver does; automatic exposure overrides exposure time."""

    def __init__(self, knobs: dict[int, Knob]) -> None:
        self.path, self.card, self.knobs = "/dev/video9", "Fake Camera", knobs
        self.written: list[int] = []

    def try_call(self, request: int, argument: Any) -> None:
        if request == abi.Vidioc.QUERY_EXT_CTRL:
            if argument.id & abi.CtrlFlag.NEXT_CTRL:
                after = argument.id & ~abi.CtrlFlag.NEXT_CTRL
                argument.id = min((known for known in self.knobs if known > after), default=0)
            self._query(argument)
        elif request == abi.Vidioc.QUERYMENU:
            name = self._knob(argument.id).menu.get(argument.index)
            if name is None:
                raise OSError(errno.EINVAL, "Invalid argument")
            argument.item.name = name.encode()
        else:
            item = argument.controls[0]
            knob = self._knob(item.id)
            if request == abi.Vidioc.G_EXT_CTRLS:
                item.payload.value = knob.value
            else:
                self._write(item.id, knob, item.payload.value)

    def _knob(self, control_id: int) -> Knob:
        if control_id not in self.knobs:
            raise OSError(errno.EINVAL, "Invalid argument")
        return self.knobs[control_id]

    def _exposes_by_itself(self) -> bool:
        return AUTO in self.knobs and self.knobs[AUTO].value != abi.EXPOSURE_MANUAL

    def _query(self, query: abi.QueryExtCtrl) -> None:
        knob = self._knob(query.id)
        query.name, query.minimum, query.maximum = knob.name.encode(), knob.minimum, knob.maximum
        boolean = (knob.minimum, knob.maximum) == (0, 1)
        plain = abi.CtrlType.BOOLEAN if boolean else abi.CtrlType.INTEGER
        query.type = abi.CtrlType.MENU if knob.menu else plain
        query.flags = knob.flags
        if query.id == TIME and self._exposes_by_itself():
            query.flags |= abi.CtrlFlag.INACTIVE

    def _write(self, control_id: int, knob: Knob, value: int) -> None:
        self.written.append(control_id)
        if control_id == TIME and self._exposes_by_itself():
            raise OSError(errno.EIO, "Input/output error")
        if not knob.stubborn:
            knob.value = value


class StreamingCamera(FakeCamera):
    """A `FakeCamera` that a `V4l2Camera` can open."""

    driver, bus = "fake", "usb"

    def __init__(self, _path: str) -> None:
        super().__init__(usual_knobs() | {abi.Cid.BRIGHTNESS: Knob("Brightness", 128, 0, 255)})

    def set_format(self, _fourcc: str, width_px: int, _height_px: int) -> VideoFormat:
        return VideoFormat(width_px, "full range")

    def set_frame_rate(self, rate_hz: float) -> float:
        return 1.0 / rate_hz

    def claim(self, buffers: int) -> int:
        return buffers

    def start(self) -> None:
        pass

    def close(self) -> None:
        pass


def config(**changes: object) -> V4l2CameraConfig:
    values: dict[str, object] = {"kind": "v4l2", "device": "/dev/video9"}
    return V4l2CameraConfig.model_validate(values | changes)


def test_all_controls_are_set_and_manual_exposure_is_first() -> None:
    camera = FakeCamera(usual_knobs())
    mode = set_measurement_mode(camera, config(exposure_ms=12.34, gain=0, gamma=100))
    values = {control_id: knob.value for control_id, knob in camera.knobs.items()}
    assert camera.written[:2] == [AUTO, TIME]
    assert values == {
        AUTO: abi.EXPOSURE_MANUAL,
        TIME: 123,
        PRIORITY: 0,
        abi.Cid.AUTO_WHITE_BALANCE: 0,
        abi.Cid.FOCUS_AUTO: 0,
        abi.Cid.BACKLIGHT_COMPENSATION: 0,
        # The minimum: this control has no zero.
        abi.Cid.SHARPNESS: 1,
        abi.Cid.GAIN: 0,
        abi.Cid.GAMMA: 100,
    }
    assert mode.exposure_s == pytest.approx(0.0123)
    assert len(mode.settings) == len(values)


def test_unconfigured_gain_and_gamma_are_unchanged() -> None:
    camera = FakeCamera(usual_knobs())
    set_measurement_mode(camera, config())
    assert camera.knobs[abi.Cid.GAIN].value == 64
    assert abi.Cid.GAIN not in camera.written


def test_a_control_with_the_right_value_is_not_written() -> None:
    camera = FakeCamera(usual_knobs())
    set_measurement_mode(camera, config())
    camera.written.clear()
    set_measurement_mode(camera, config())
    assert camera.written == []


@pytest.mark.parametrize("control_id", usual_knobs())
def test_a_control_that_keeps_its_value_is_named(control_id: int) -> None:
    knobs = usual_knobs()
    knobs[control_id].stubborn = True
    if control_id == abi.Cid.GAMMA:
        knobs[control_id].value = 72
    slug = knobs[control_id].name.lower().replace(",", "").replace(" ", "_")
    with pytest.raises(CameraError, match=f"/dev/video9: control {slug} was set"):
        set_measurement_mode(FakeCamera(knobs), config(gain=0, gamma=100))


def test_a_camera_without_manual_exposure_is_refused() -> None:
    knobs = usual_knobs()
    del knobs[AUTO].menu[abi.EXPOSURE_MANUAL]
    with pytest.raises(CameraError, match=r"auto_exposure = 1 .* 3 \(Aperture Priority"):
        set_measurement_mode(FakeCamera(knobs), config())


def test_an_exposure_overridden_by_another_control_is_refused() -> None:
    knobs = usual_knobs()
    del knobs[AUTO]
    knobs[TIME].flags = abi.CtrlFlag.INACTIVE
    with pytest.raises(CameraError, match="exposure_time_absolute has no effect"):
        set_measurement_mode(FakeCamera(knobs), config())


def test_fixed_exposure_is_refused_with_an_exposure_control() -> None:
    with pytest.raises(CameraError, match=r"remove camera\.fixed_exposure"):
        set_measurement_mode(FakeCamera(usual_knobs()), config(fixed_exposure=True))


def test_a_read_only_control_must_be_off() -> None:
    knobs = usual_knobs()
    knobs[PRIORITY] = Knob("Exposure, Dynamic Framerate", 0, flags=abi.CtrlFlag.READ_ONLY)
    set_measurement_mode(FakeCamera(knobs), config())
    knobs[PRIORITY].value = 1
    with pytest.raises(CameraError, match="exposure_dynamic_framerate is read-only"):
        set_measurement_mode(FakeCamera(knobs), config())


def test_the_controls_are_listed() -> None:
    camera = FakeCamera(usual_knobs())
    listed = list(list_controls(camera))
    assert [control.id for control in listed] == sorted(camera.knobs)
    auto = next(control for control in listed if control.id == AUTO)
    assert auto.menu == {1: "Manual Mode", APERTURE_PRIORITY: "Aperture Priority Mode"}


def test_a_control_that_the_driver_refuses_is_named() -> None:
    class Refusing(FakeCamera):
        def _write(self, *_: object) -> None:
            raise OSError(errno.EBUSY, "Device or resource busy")

    with pytest.raises(CameraError, match="auto_exposure refuses 1: in use"):
        set_measurement_mode(Refusing(usual_knobs()), config())


STUBBORN = (
    (abi.Cid.FOCUS_AUTO, "focus_automatic_continuous was set to 0 and reads 1"),
    (abi.Cid.SHARPNESS, "sharpness was set to 1 and reads 5"),
    (abi.Cid.GAIN, "gain was set to 0 and reads 64"),
)


def test_all_stubborn_controls_are_named_with_one_remedy() -> None:
    knobs = usual_knobs()
    for control_id, _ in STUBBORN:
        knobs[control_id].stubborn = True
    with pytest.raises(ControlError) as raised:
        set_measurement_mode(FakeCamera(knobs), config(gain=0, gamma=1))
    messages = [f"control {finding}" for _, finding in STUBBORN]
    messages.append("control gamma = 1 is not possible; it takes 72 to 500")
    assert [fault.message for fault in raised.value.faults] == messages
    assert str(raised.value).startswith("/dev/video9: " + "; ".join(messages))
    assert str(raised.value).count("v4l2-ctl -d /dev/video9") == 1
    # The other controls are set, and the doctor has a line for each fault.
    assert knobs[abi.Cid.AUTO_WHITE_BALANCE].value == 0
    checks = list(check_controls(raised.value))
    assert [(check.status, check.seen) for check in checks] == [
        ("fault", message) for message in messages
    ]
    assert all("use another camera" in check.advice for check in checks)


def test_all_controls_that_change_later_are_named() -> None:
    camera = FakeCamera(usual_knobs())
    mode = set_measurement_mode(camera, config(gain=0))
    for control_id, finding in STUBBORN:
        camera.knobs[control_id].value = int(finding.split()[-1])
    with pytest.raises(ControlError) as raised:
        check_measurement_mode(camera, mode)
    assert [fault.message for fault in raised.value.faults] == [
        f"control {finding}" for _, finding in STUBBORN
    ]


def test_the_exposure_changes_within_the_range_of_its_control() -> None:
    camera = FakeCamera(usual_knobs())
    mode = set_measurement_mode(camera, config(exposure_ms=20.0))
    assert exposure_range_ms(camera, config()) == (0.3, 204.7)
    changed = set_exposure(camera, mode, 5.0)
    assert camera.knobs[TIME].value == 50
    assert changed.exposure_s == pytest.approx(0.005)
    check_measurement_mode(camera, changed)
    with pytest.raises(ControlError, match=r"takes 0\.3 to 204\.7 ms"):
        set_exposure(camera, changed, 300.0)


def test_a_fixed_exposure_has_no_range() -> None:
    knobs = usual_knobs()
    del knobs[TIME]
    assert exposure_range_ms(FakeCamera(knobs), config(fixed_exposure=True)) == (20.0, 20.0)
