"""The controls of a V4L2 device, by numeric id, which no kernel changes."""

import ctypes
import errno
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from rig.errors import CameraFault, ControlError

from . import abi
from .device import V4l2Device

_MENUS = (abi.CtrlType.MENU, abi.CtrlType.INTEGER_MENU)
# Controls with one integer value; buttons, texts and arrays cannot be read back.
_READABLE = (
    abi.CtrlType.INTEGER,
    abi.CtrlType.BOOLEAN,
    abi.CtrlType.INTEGER64,
    abi.CtrlType.BITMASK,
    *_MENUS,
)
# Errors of the whole device, not of a control.
_DEVICE_ERRORS = (errno.ENODEV, errno.ENXIO, errno.EBUSY)
_USE_ANOTHER_CAMERA = "use another camera, because images of this one cannot be measured"
# Bounds the lists of a faulty driver; real ones have fewer than 100 entries.
_MAX_CONTROLS = 1024
_MAX_MENU = 256


@dataclass(frozen=True)
class Control:
    """One control as the driver describes it; a menu of values may have gaps."""

    id: int
    kind: int
    name: str
    minimum: int
    maximum: int
    flags: int
    menu: Mapping[int, str] = field(default_factory=dict)

    @property
    def slug(self) -> str:
        """The name in lower case with underscores, as v4l2-ctl prints it."""
        return re.sub(r"[^a-z0-9]+", "_", self.name.lower()).strip("_")

    @property
    def is_readable(self) -> bool:
        """Whether it has an integer value."""
        return self.kind in _READABLE and not self.flags & abi.CtrlFlag.WRITE_ONLY

    def allowed(self) -> str:
        """The allowed values as text."""
        if self.menu:
            return ", ".join(f"{value} ({name})" for value, name in self.menu.items())
        return f"{self.minimum} to {self.maximum}"


def find_control(device: V4l2Device, control_id: int) -> Control | None:
    """Query one control; None if the device lacks it or has disabled it."""
    query = _query(device, control_id)
    if query is None or query.flags & abi.CtrlFlag.DISABLED:
        return None
    return Control(
        id=query.id,
        kind=query.type,
        name=abi.text(query.name),
        minimum=query.minimum,
        maximum=query.maximum,
        flags=query.flags,
        menu=dict(_menu(device, query)) if query.type in _MENUS else {},
    )


def list_controls(device: V4l2Device) -> Iterator[Control]:
    """All controls in the order of their ids, including buttons."""
    after = 0
    for _ in range(_MAX_CONTROLS):
        query = _query(device, after | abi.CtrlFlag.NEXT_CTRL)
        if query is None or query.id <= after:
            return
        after = query.id
        control = find_control(device, query.id)
        if control is not None:
            yield control


def read_control(device: V4l2Device, control: Control) -> int:
    """Read the value of a control from the driver."""
    ext_control = abi.ExtControl(id=control.id)
    device.call(f"cannot read control {control.slug}", abi.Vidioc.G_EXT_CTRLS, _single(ext_control))
    is_64_bit = control.kind == abi.CtrlType.INTEGER64
    return int(ext_control.payload.value64 if is_64_bit else ext_control.payload.value)


def write_control(device: V4l2Device, control: Control, value: int) -> None:
    """Set a control and read it back."""
    # The kernel would clamp the value without an error.
    allowed = value in control.menu if control.menu else control.minimum <= value <= control.maximum
    if not allowed:
        raise _error(
            device,
            control,
            f"= {value} is not possible; it takes {control.allowed()}",
            "set one of these values, or use another camera",
        )
    if control.flags & abi.CtrlFlag.READ_ONLY:
        value_text = _value_text(device, control)
        raise _error(
            device,
            control,
            f"is read-only{value_text}; it cannot be set to {value}",
            _USE_ANOTHER_CAMERA,
        )
    ext_control = abi.ExtControl(id=control.id)
    if control.kind == abi.CtrlType.INTEGER64:
        ext_control.payload.value64 = value
    else:
        ext_control.payload.value = value
    try:
        device.try_call(abi.Vidioc.S_EXT_CTRLS, _single(ext_control))
    except OSError as error:
        if error.errno in _DEVICE_ERRORS:
            device.fail(f"control {control.slug} refuses {value}", error)
        finding = f"refuses {value} ({error.strerror}){_value_text(device, control)}"
        raise _error(device, control, finding) from error
    if control.is_readable:
        check_control(device, control, value)


def check_control(device: V4l2Device, control: Control, value: int) -> None:
    """Raise a `ControlError` that names the control if its value is not `value`."""
    value_now = read_control(device, control)
    if value_now != value:
        raise _error(device, control, f"was set to {value} and reads {value_now}")


def _error(device: V4l2Device, control: Control, finding: str, advice: str = "") -> ControlError:
    """An error about a control; the default advice is for one that does not keep its value."""
    advice = advice or (
        "the camera does not obey: close other programs that use it; if v4l2-ctl -d "
        f"{device.path} cannot set it either, {_USE_ANOTHER_CAMERA}"
    )
    fault = CameraFault(control.slug, f"control {control.slug} {finding}", advice)
    return ControlError(device.path, fault)


def _value_text(device: V4l2Device, control: Control) -> str:
    """The value of a readable control, as the end of a message."""
    return f" and reads {read_control(device, control)}" if control.is_readable else ""


def _query(device: V4l2Device, control_id: int) -> abi.QueryExtCtrl | None:
    """The driver's description of a control, or of the next one; None if there is none."""
    query = abi.QueryExtCtrl(id=control_id)
    try:
        device.try_call(abi.Vidioc.QUERY_EXT_CTRL, query)
    except OSError as error:
        if error.errno in (errno.EINVAL, errno.ENOTTY):  # ENOTTY: the driver has no controls
            return None
        device.fail(f"cannot query control {control_id:#x}", error)
    return query


def _single(ext_control: abi.ExtControl) -> abi.ExtControls:
    return abi.ExtControls(count=1, controls=ctypes.pointer(ext_control))


def _menu(device: V4l2Device, query: abi.QueryExtCtrl) -> Iterator[tuple[int, str]]:
    for index in range(max(query.minimum, 0), min(query.maximum, _MAX_MENU) + 1):
        entry = abi.QueryMenu(id=query.id, index=index)
        try:
            device.try_call(abi.Vidioc.QUERYMENU, entry)
        except OSError as error:
            # Menus have gaps.
            if error.errno == errno.EINVAL:
                continue
            device.fail(f"cannot list the menu of control {query.id:#x}", error)
        if query.type == abi.CtrlType.MENU:
            yield index, abi.text(entry.item.name)
        else:
            yield index, str(entry.item.value)
