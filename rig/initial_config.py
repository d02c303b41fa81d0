"""The commented ``rig.toml`` that ``ps4rig rig init`` writes for found devices."""

import json
import re
from collections.abc import Callable, Sequence

from .cameras.config import PIXEL_FORMAT_BITS
from .cameras.v4l2.camera_list import ListedCamera
from .cameras.v4l2.pixel_formats import PIXEL_FORMATS
from .config.lights import AUTO
from .errors import LightControllerError
from .lights.discovery import SerialPort, identify
from .lights.link import ControllerIdentity

Controllers = Sequence[tuple[SerialPort, ControllerIdentity]]

# Pixel formats, best first: grey before colour, whose filters cost light and resolution; more bits
# before fewer; compressed last.
_PREFERRED = sorted(
    PIXEL_FORMAT_BITS,
    key=lambda name: (
        name == "MJPG",
        not name.startswith(("Y1", "GREY")),
        name in ("RGB24", "BGR24"),
        -PIXEL_FORMAT_BITS[name],
    ),
)
# Larger frames seldom reach 30 Hz over USB 2, and then the camera is not opened.
_MOST_COLUMNS = 1280


def answering_controllers(
    ports: Sequence[SerialPort], ask: Callable[[str], ControllerIdentity] = identify
) -> list[tuple[SerialPort, ControllerIdentity]]:
    """The light controllers that answer at `ports`, in their order."""
    controllers = []
    for port in ports:
        try:
            controllers.append((port, ask(port.device)))
        except LightControllerError:
            continue
    return controllers


def initial_config(controllers: Controllers, cameras: Sequence[ListedCamera]) -> str:
    """A ``rig.toml`` for the first controller and camera that work, with the others in comments."""
    return "\n".join(
        [
            "# The rig, written by ps4rig rig init from what was plugged in. A line that begins",
            "# with # is a comment. Check the rig with: ps4rig rig doctor",
            "",
            'name = "rig"',
            '# calibration = "rig.ps4cal"    # from ps4rig calibrate, for all captures',
            "",
            "[lights]",
            *_port_lines(controllers),
            "tilts_deg = [0, 90, 180, 270]  # of LED 0, 1, 2, 3; anticlockwise from the right",
            "slant_deg = 45                 # from the camera's axis; measure it on the rig",
            "settle_ms = 5                  # from the acknowledge until the light is steady",
            "watchdog_ms = 5000             # silence after which the controller puts LEDs out",
            "",
            "[camera]",
            'kind = "v4l2"',
            *_camera_lines(cameras),
            "frame_rate_hz = 30",
            "exposure_ms = 20               # ps4rig rig doctor suggests a better value",
            "# Next, ps4rig rig latency measures the camera's time stamps and adds its keys.",
            "",
        ]
    )


def _port_lines(controllers: Controllers) -> list[str]:
    lines = [
        f"# Found: light controller {who.serial_number} ({who.model}, firmware "
        f"{who.firmware_version}) at {port.by_id or port.device}"
        for port, who in controllers
    ]
    if not controllers:
        return [
            "# No light controller answered. Plug it in and run ps4rig rig init --force, or remove",
            "# the # and give its port:",
            '# port = "/dev/ttyACM0"',
        ]
    port, who = controllers[0]
    if not port.may_be_a_microcontroller:  # "auto" would not ask there
        return [*lines, f"port = {_text(port.by_id or port.device)}"]
    lines.append(f'port = "{AUTO}"                  # found wherever it is plugged in')
    if len(controllers) > 1:
        lines.append(f"serial_number = {_text(who.serial_number)}")
    return lines


def _camera_lines(cameras: Sequence[ListedCamera]) -> list[str]:
    lines = []
    for camera in cameras:
        if camera.problem is not None:
            lines.append(f"# Found, but it cannot be used: {camera.problem}")
            continue
        lines.append(f"# Found: {camera.name} ({camera.driver}) at {camera.device}, with")
        lines += [f"#   {each.fourcc} {' '.join(each.sizes)}".rstrip() for each in camera.formats]
    usable = [(camera, name) for camera in cameras if (name := _best_format(camera)) is not None]
    if not usable:
        return [
            *lines,
            "# No camera with a known pixel format was found. Plug one in and run ps4rig rig init",
            "# --force, or remove the # and give its path, best its name in /dev/v4l/by-id:",
            '# device = "/dev/video0"',
            'pixel_format = "GREY"',
            "width_px = 512",
            "height_px = 512",
        ]
    camera, name = usable[0]
    width_px, height_px = _size(camera, name)
    lines.append(f"device = {_text(camera.device)}")
    lines.append(f"pixel_format = {_text(name)}")
    if name == "MJPG":
        lines.append("allow_compressed = true        # its losses are in every slope")
    return [*lines, f"width_px = {width_px}", f"height_px = {height_px}"]


def _best_format(camera: ListedCamera) -> str | None:
    offered = {each.fourcc.strip() for each in camera.formats}
    names = (name for name in _PREFERRED if PIXEL_FORMATS[name].fourcc.strip() in offered)
    return next(names, None)


def _size(camera: ListedCamera, name: str) -> tuple[int, int]:
    """The largest listed size of at most `_MOST_COLUMNS`, else the smallest; 512 x 512 if none."""
    fourcc = PIXEL_FORMATS[name].fourcc.strip()
    texts = [
        text for each in camera.formats if each.fourcc.strip() == fourcc for text in each.sizes
    ]
    matches = [re.fullmatch(r"(\d+)x(\d+)", text) for text in texts]
    sizes = [(int(match[1]), int(match[2])) for match in matches if match]
    small = [size for size in sizes if size[0] <= _MOST_COLUMNS]
    return max(small, default=min(sizes, default=(512, 512)))


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)
