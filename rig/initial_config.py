"""The commented ``rig.toml`` that ``ps4rig rig init`` writes from what is plugged in."""

import json
from collections.abc import Sequence

from .cameras.camera import ListedCamera
from .config.lights import AUTO
from .errors import LightControllerError
from .lights.discovery import SerialPort, identify
from .lights.link import ControllerIdentity

_Controller = tuple[SerialPort, ControllerIdentity]


def answering_controllers(ports: Sequence[SerialPort]) -> list[_Controller]:
    """The light controllers that answer at `ports`, in their order."""
    controllers = []
    for port in ports:
        try:
            controllers.append((port, identify(port.device)))
        except LightControllerError:
            continue
    return controllers


def initial_config(controllers: Sequence[_Controller], cameras: Sequence[ListedCamera]) -> str:
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
            "settle_ms = 5                  # from the acknowledgement until the light is steady",
            "watchdog_ms = 5000             # silence after which the controller puts LEDs out",
            "",
            "[camera]",
            *_camera_lines(cameras),
            "frame_rate_hz = 30",
            "exposure_ms = 20               # ps4rig rig doctor suggests a better value",
            "# Next, ps4rig rig latency measures the camera's time stamps and adds its keys.",
            "",
        ]
    )


def _port_lines(controllers: Sequence[_Controller]) -> list[str]:
    lines = [
        _comment(
            f"Found: light controller {identity.serial_number} ({identity.model}, firmware "
            f"{identity.firmware_version}) at {port.by_id or port.device}"
        )
        for port, identity in controllers
    ]
    if not controllers:
        return [
            "# No light controller answered. Plug it in and run ps4rig rig init --force, or remove",
            "# the # and give its port:",
            '# port = "/dev/ttyACM0"',
        ]
    port, identity = controllers[0]
    if not port.may_be_a_microcontroller:  # "auto" does not try such ports
        return [*lines, f"port = {_toml_string(port.by_id or port.device)}"]
    lines.append(f'port = "{AUTO}"                  # found wherever it is plugged in')
    if len(controllers) > 1:
        lines.append(f"serial_number = {_toml_string(identity.serial_number)}")
    return lines


def _camera_lines(cameras: Sequence[ListedCamera]) -> list[str]:
    lines = []
    for camera in cameras:
        if camera.problem is not None:
            lines.append(_comment(f"Found, but it cannot be used: {camera.problem}"))
            continue
        lines.append(_comment(f"Found: {camera.name} ({camera.driver}) at {camera.device}, with"))
        lines += [_comment(f"  {text}") for text in camera.formats]
    usable = next((camera for camera in cameras if camera.config_lines), None)
    if usable is not None:
        kind, device = _toml_string(usable.kind), _toml_string(usable.device)
        return [*lines, f"kind = {kind}", f"device = {device}", *usable.config_lines]
    return [
        *lines,
        'kind = "v4l2"',
        "# No camera with a known pixel format was found. Plug one in and run ps4rig rig init",
        "# --force, or remove the # and give its path, best its name in /dev/v4l/by-id:",
        '# device = "/dev/video0"',
        'pixel_format = "GREY"',
        "width_px = 512",
        "height_px = 512",
    ]


def _comment(text: str) -> str:
    """One line of comment; a name that a device reports may contain control characters."""
    return "# " + "".join(letter if letter.isprintable() else " " for letter in text)


def _toml_string(value: str) -> str:
    # The escapes of JSON are valid in TOML.
    return json.dumps(value, ensure_ascii=False)
