"""List the cameras that are plugged in and what each can do, without claiming any."""

from dataclasses import dataclass
from pathlib import Path

from rig.errors import CameraError

from .controls import Control, list_controls, read_control
from .device import NoCaptureDeviceError, OfferedFormat, V4l2Device

_DEV = Path("/dev")


@dataclass(frozen=True)
class ListedCamera:
    """One capture node.

    Attributes
    ----------
    node
        Device node, whose number depends on the order in which cameras are plugged in.
    by_id
        Permanent names in ``/dev/v4l/by-id``.
    name, driver, bus
        As the driver reports them; empty if the camera could not be opened.
    formats
        All offered formats, also those that cannot be decoded here.
    controls
        Controls with their values; None for a control without an integer value.
    problem
        Error of the query, None if it succeeded.
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
        """The value for ``camera.device``: a permanent name, if there is one."""
        return str(self.by_id[0] if self.by_id else self.node)


def device_path(device: str, dev: Path = _DEV) -> str:
    """The path of ``camera.device``: a path, a name in ``/dev/v4l/by-id``, or a number."""
    if "/" in device:
        return device
    return str(dev / f"video{device}" if device.isdecimal() else dev / "v4l" / "by-id" / device)


def list_cameras(dev: Path = _DEV) -> list[ListedCamera]:
    """List every capture node in the order of its number.

    A node that cannot be queried has a `problem`. Nodes that do not capture, such as a USB camera's
    second one for metadata, are left out. A camera in use by another program is listed too.
    """
    nodes = [path for path in dev.glob("video*") if path.name[len("video") :].isdecimal()]
    names = sorted((dev / "v4l" / "by-id").glob("*"))
    cameras = []
    for node in sorted(nodes, key=lambda path: int(path.name[len("video") :])):
        by_id = tuple(name for name in names if name.resolve() == node.resolve())
        try:
            cameras.append(_listed(node, by_id))
        except NoCaptureDeviceError:
            continue
        except CameraError as error:
            cameras.append(ListedCamera(node, by_id, problem=str(error)))
    return cameras


def _listed(node: Path, by_id: tuple[Path, ...]) -> ListedCamera:
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
