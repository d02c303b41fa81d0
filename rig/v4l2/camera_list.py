"""Which cameras are plugged in, and what each can do; nothing is changed and none is claimed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.errors import CameraError

from .controls import Control, list_controls, read_control
from .device import NoCaptureDeviceError, OfferedFormat, V4l2Device

__all__ = ["ListedCamera", "device_path", "list_cameras"]

_DEV = Path("/dev")


@dataclass(frozen=True)
class ListedCamera:
    """One capture node.

    Attributes
    ----------
    node
        As the kernel numbered it, which changes when cameras are plugged in another order.
    by_id
        Its names in ``/dev/v4l/by-id``, which do not change.
    name, driver, bus
        The camera's own account; empty where it could not be opened.
    formats
        All it offers, those that nobody decodes included.
    controls
        With the values that they have; None where a control has none that is one whole number.
    problem
        Why it could not be asked, None where it could.
    """

    node: Path
    by_id: tuple[Path, ...]
    name: str = ""
    driver: str = ""
    bus: str = ""
    formats: tuple[OfferedFormat, ...] = ()
    controls: tuple[tuple[Control, int | None], ...] = ()
    problem: str | None = None

    @property
    def device(self) -> str:
        """What to put into ``camera.device``: a name that stays, if there is one."""
        return str(self.by_id[0] if self.by_id else self.node)


def device_path(device: str, dev: Path = _DEV) -> str:
    """The path that ``camera.device`` means: a path, a name in ``/dev/v4l/by-id``, or a number."""
    if "/" in device:
        return device
    return str(dev / f"video{device}" if device.isdecimal() else dev / "v4l" / "by-id" / device)


def list_cameras(dev: Path = _DEV) -> list[ListedCamera]:
    """Every capture node in the order of its number; one that cannot be asked says why.

    Nodes that do not capture, such as a USB camera's second one for metadata, are left out.
    A camera that another program streams from is listed as well, and not disturbed.
    """
    nodes = [path for path in dev.glob("video*") if path.name[len("video") :].isdecimal()]
    names = sorted((dev / "v4l" / "by-id").glob("*"))
    cameras = []
    for node in sorted(nodes, key=lambda path: int(path.name[len("video") :])):
        by_id = tuple(name for name in names if name.resolve() == node.resolve())
        try:
            cameras.append(_asked(node, by_id))
        except NoCaptureDeviceError:
            continue
        except CameraError as error:
            cameras.append(ListedCamera(node, by_id, problem=str(error)))
    return cameras


def _asked(node: Path, by_id: tuple[Path, ...]) -> ListedCamera:
    device = V4l2Device(str(node))
    try:
        controls = tuple(
            (control, read_control(device, control) if control.is_readable else None)
            for control in list_controls(device)
        )
        return ListedCamera(
            node, by_id, device.card, device.driver, device.bus, tuple(device.formats()), controls
        )
    finally:
        device.close()
