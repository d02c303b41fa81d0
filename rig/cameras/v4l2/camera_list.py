"""List the V4L2 cameras that are plugged in and what each can do, without claiming any."""

import re
from collections.abc import Iterable
from pathlib import Path

from rig.cameras.camera import ListedCamera
from rig.errors import CameraError

from .abi import CID_EXPOSURE_ABSOLUTE
from .controls import find_control
from .device import NoCaptureDeviceError, OfferedFormat, V4l2Device
from .measurement_mode import EXPOSURE_UNITS_PER_MS
from .node import DEV
from .pixel_formats import PIXEL_FORMATS

# Pixel formats, best first: grey before colour, whose filters cost light and resolution; more bits
# before fewer; compressed last.
_PREFERRED = sorted(
    PIXEL_FORMATS,
    key=lambda name: (
        name == "MJPG",
        not name.startswith(("Y1", "GREY")),
        name in ("RGB24", "BGR24"),
        -PIXEL_FORMATS[name].bit_depth,
    ),
)
# Larger frames seldom reach 30 Hz over USB 2, and then the camera is not opened.
_MOST_COLUMNS = 1280


def list_v4l2_cameras(dev: Path = DEV) -> list[ListedCamera]:
    """List every capture node by its number; one that cannot be queried has a `problem`."""
    nodes = [path for path in dev.glob("video*") if path.name[len("video") :].isdecimal()]
    permanent_names = sorted((dev / "v4l" / "by-id").glob("*"))
    cameras = []
    for node in sorted(nodes, key=lambda path: int(path.name[len("video") :])):
        names = (name for name in permanent_names if name.resolve() == node.resolve())
        device = str(next(names, node))
        try:
            cameras.append(_listed(node, device))
        except NoCaptureDeviceError:
            continue
        except CameraError as error:
            cameras.append(ListedCamera("v4l2", device, node=node, problem=str(error)))
    return cameras


def _listed(node: Path, device_name: str) -> ListedCamera:
    device = V4l2Device(str(node))
    try:
        exposure = find_control(device, CID_EXPOSURE_ABSOLUTE)
        formats = tuple(device.formats())
        return ListedCamera(
            "v4l2",
            device_name,
            device.card,
            device.driver,
            node,
            tuple(f"{offered.fourcc} {' '.join(offered.sizes)}".rstrip() for offered in formats),
            None if exposure is None else exposure.maximum / EXPOSURE_UNITS_PER_MS,
            config_lines(formats),
        )
    finally:
        device.close()


def config_lines(formats: Iterable[OfferedFormat]) -> tuple[str, ...]:
    """Lines of ``[camera]`` with the best offered format that can be decoded; empty without one."""
    sizes = {offered.fourcc.strip(): offered.sizes for offered in formats}
    fourccs = {name: PIXEL_FORMATS[name].fourcc.strip() for name in _PREFERRED}
    name = next((name for name, fourcc in fourccs.items() if fourcc in sizes), None)
    if name is None:
        return ()
    width_px, height_px = _size(sizes[fourccs[name]])
    lines = [f'pixel_format = "{name}"', f"width_px = {width_px}", f"height_px = {height_px}"]
    if name == "MJPG":
        lines.append("allow_compressed = true        # its losses are in every slope")
    return tuple(lines)


def _size(texts: Iterable[str]) -> tuple[int, int]:
    """The largest listed size of at most `_MOST_COLUMNS`, else the smallest; 512 x 512 if none."""
    matches = [re.fullmatch(r"(\d+)x(\d+)", text) for text in texts]
    sizes = [(int(match[1]), int(match[2])) for match in matches if match]
    small = [size for size in sizes if size[0] <= _MOST_COLUMNS]
    return max(small, default=min(sizes, default=(512, 512)))
