"""Checks of the devices of a rig: serial ports, light controller, cameras, frames."""

import os
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path

from firmware_sim import Clock
from firmware_sim.firmware import FIRMWARE_VERSION
from rig.cameras.camera import Camera, CameraInfo, Frame, ListedCamera
from rig.cameras.config import CameraConfig, DeviceCameraConfig
from rig.cameras.kinds import CAMERA_KINDS
from rig.config.lights import LightsConfig
from rig.errors import CameraError, ControlError
from rig.lights.discovery import SerialPort
from rig.lights.driver import LightController, switch_latencies_ms
from rig.lights.serial_line import port_holders

from .check import Check

RULES_FILE = Path(__file__).with_name("70-ps4rig.rules")
_RULES_FOLDERS = (Path("/etc/udev/rules.d"), Path("/usr/lib/udev/rules.d"))
_PROC = Path("/proc")
_INSTALL_RULES = (
    f"sudo install -m 644 {RULES_FILE} {_RULES_FOLDERS[0]}/ && "
    "sudo udevadm control --reload && sudo udevadm trigger"
)


def check_ports(ports: Sequence[SerialPort], is_simulated: bool) -> Iterator[Check]:
    """List each serial port; warn if none can be a light controller's."""
    for port in ports:
        holders = ", ".join(map(str, port_holders(port.device)))
        link = port.by_id and f"also {port.by_id}"
        use = f"in use by {holders}" if holders else "not in use"
        kind = "may be a board" if port.may_be_a_microcontroller else "not known as a board"
        parts = (str(port), port.description, link, use, kind)
        yield Check("serial port", "ok", "; ".join(filter(None, parts)))
    if not is_simulated and not any(port.may_be_a_microcontroller for port in ports):
        finding = f"none of {len(ports)} ports belongs to a known board"
        advice = "plug the light controller in; with a charging cable no port appears"
        yield Check("serial ports", "warning", finding, advice)


def check_port(device: str) -> Iterator[Check]:
    """Check that the light controller's port exists, is permitted, and is not in use."""
    if "://" in device:
        yield Check("port", "ok", f"{device} is not a device of this machine")
        return
    if not Path(device).exists():
        advice = 'is the controller plugged in? With lights.port = "auto" it is searched for'
        yield Check("port", "fault", f"{device} does not exist", advice)
        return
    yield _check_access(device)
    holders = [holder for holder in port_holders(device) if holder.pid != os.getpid()]
    if holders:
        finding = f"{device} is open in {', '.join(map(str, holders))}"
        yield Check("port in use", "fault", finding, "close that program")
    else:
        yield Check("port in use", "ok", f"no visible program has {device} open")


def _check_access(device: str) -> Check:
    """Check that this user may read and write a device; name a missing group or rule."""
    name = "permission"
    if os.access(device, os.R_OK | os.W_OK):
        return Check(name, "ok", f"{device} may be read and written")
    status = Path(device).stat()
    try:
        import grp
    except ImportError:  # Windows, whose files have no groups
        return Check(name, "fault", f"{device}: you may not read and write it", "ask for access")
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = str(status.st_gid)
    if status.st_gid in os.getgroups():
        note, join = "its group is one of yours, but ", ""
    else:
        note, join = "", f"sudo usermod -aG {group} $USER and log in again, or "
    mode = f"{status.st_mode & 0o777:o}"
    finding = f"{device} belongs to group {group}, mode {mode}; {note}you may not read and write it"
    return Check(name, "fault", finding, f"{join}install the udev rules: {_INSTALL_RULES}")


def check_modem_manager(
    proc: Path = _PROC, rules_folders: Sequence[Path] = _RULES_FOLDERS
) -> Check:
    """Check that ModemManager, which talks to every new serial port, leaves boards alone."""
    name = "ModemManager"
    if not any(_is_modem_manager(path) for path in proc.glob("[0-9]*/comm")):
        return Check(name, "ok", "is not running")
    if any((folder / RULES_FILE.name).exists() for folder in rules_folders):
        return Check(name, "ok", f"is running, and {RULES_FILE.name} keeps it away from boards")
    finding = "is running, and treats a board as a modem for some seconds after it is plugged in"
    return Check(name, "warning", finding, _INSTALL_RULES)


def _is_modem_manager(comm: Path) -> bool:
    try:
        return comm.read_text(encoding="utf-8", errors="replace").strip() == "ModemManager"
    except OSError:  # it has just ended
        return False


# A timer in a USB chip (16 ms in an FTDI) or a loaded machine causes slower switches, which add to
# the time of each set.
_SLOW_SWITCH_MS = 10.0


def check_lights(lights: LightController, clock: Clock, config: LightsConfig) -> Iterator[Check]:
    """Check identity, number of LEDs, watchdog and switch time; LEDs are lit and put out again."""
    yield _identity(lights)
    yield _led_count(lights, config)
    yield _watchdog(lights)
    yield _switch_latency(lights, clock)


def _identity(lights: LightController) -> Check:
    controller = lights.identity
    finding = (
        f"{controller.model} {controller.serial_number} on {lights.port}, "
        f"firmware {controller.firmware_version}, protocol {controller.protocol_version}"
    )
    if controller.firmware_version != FIRMWARE_VERSION:
        finding += f"; this program brings firmware {FIRMWARE_VERSION}"
        return Check("light controller", "warning", finding, "ps4rig rig flash")
    return Check("light controller", "ok", finding)


def _led_count(lights: LightController, config: LightsConfig) -> Check:
    configured = len(config.tilts_deg)
    finding = f"the controller has {lights.led_count}, lights.tilts_deg names {configured}"
    if configured > lights.led_count:
        return Check("LEDs", "fault", finding, "correct lights.tilts_deg, or the board's LED_PINS")
    return Check("LEDs", "ok", finding)


def _watchdog(lights: LightController) -> Check:
    if lights.trips_watchdog():
        return Check("watchdog", "ok", "an LED went out by itself when no command came")
    finding = "an LED stayed on although no command came"
    return Check("watchdog", "fault", finding, "renew the firmware with ps4rig rig flash")


def _switch_latency(lights: LightController, clock: Clock) -> Check:
    latencies_ms = switch_latencies_ms(lights, clock)
    median_ms = statistics.median(latencies_ms)
    finding = (
        f"median {median_ms:.2f} ms, worst {max(latencies_ms):.2f} ms of {len(latencies_ms)}, "
        "from writing to acknowledgement"
    )
    if median_ms <= _SLOW_SWITCH_MS:
        return Check("switch latency", "ok", finding)
    # A port below /dev/serial/by-id is a link to the device that sysfs names.
    name = Path(lights.port).resolve().name
    advice = (
        "with an FTDI chip, lower its timer: "
        f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer; otherwise end other "
        "programs that load the machine"
    )
    return Check("switch latency", "warning", finding, advice)


# Number of frames from which rate and losses are measured. A slow camera gives only those of
# _MAX_RATE_CHECK_S, but at least 3.
_FRAMES, _MAX_RATE_CHECK_S = 30, 10.0
_READ_TIMEOUT_S = 2.0  # on top of a frame period, for a camera that has just started to stream
# 30 frames whose first and last stamp jitter by half a period give the rate to 3 %.
_RATE_TOLERANCE = 0.05
_MAX_FORMATS = 6  # limit of one line of the report


def check_cameras(cameras: Sequence[ListedCamera], config: CameraConfig | None) -> Iterator[Check]:
    """Check each camera of this machine, and the permission for the rig's own."""
    for camera in cameras:
        if camera.problem is not None:
            is_usable = camera.node is None or os.access(camera.node, os.R_OK | os.W_OK)
            advice = "" if is_usable else f"install the udev rules: {_INSTALL_RULES}"
            yield Check("camera", "warning", camera.problem, advice)
            continue
        formats = ", ".join(camera.formats[:_MAX_FORMATS])
        more = len(camera.formats) - _MAX_FORMATS
        more_formats = f" and {more} more formats" if more > 0 else ""
        finding = f"{camera.name} ({camera.driver}) at {camera.device}: {formats}{more_formats}"
        yield Check("camera", "ok", finding)
    if isinstance(config, DeviceCameraConfig):
        rig_camera = next((camera for camera in cameras if config.matches(camera)), None)
        if rig_camera is not None and rig_camera.node is not None:
            yield _check_access(str(rig_camera.node))
        elif rig_camera is None:
            finding = f"{config.device} is not among the {len(cameras)} cameras found"
            advice = "is it plugged in? Set camera.device to one of the names above"
            yield Check("camera.device", "fault", finding, advice)


def check_controls(error: ControlError) -> Iterator[Check]:
    """Report each control that prevents a camera from being opened as one fault."""
    for fault in error.faults:
        yield Check(f"control {fault.name}", "fault", fault.message, fault.advice)


def check_frames(camera: Camera) -> Iterator[Check]:
    """Check the frame rate and what the camera's kind needs; count lost and corrupt frames."""
    info = camera.info
    yield from _check_kind(info)
    frames = max(3, min(_FRAMES, round(_MAX_RATE_CHECK_S / info.frame_period_s)))
    read_frames: list[Frame] = []
    for number in range(info.queue_length + frames):
        frame = camera.read(_READ_TIMEOUT_S + info.frame_period_s)
        if number >= info.queue_length:  # frames that waited in the queue do not show the rate
            read_frames.append(frame)
    steps = read_frames[-1].sequence - read_frames[0].sequence
    elapsed_s = read_frames[-1].exposure_start_s - read_frames[0].exposure_start_s
    if steps <= 0 or elapsed_s <= 0.0:
        numbers = f"{read_frames[0].sequence} to {read_frames[-1].sequence}"
        raise CameraError(
            f"{frames} frames from number {numbers} in {elapsed_s:.3f} s: the camera's numbers or "
            "time stamps do not advance"
        )
    rate_hz, configured_hz = steps / elapsed_s, 1.0 / info.frame_period_s
    finding = f"{rate_hz:.2f} Hz reached, {configured_hz:.2f} Hz asked for"
    if abs(rate_hz / configured_hz - 1.0) <= _RATE_TOLERANCE:
        yield Check("frame rate", "ok", finding)
    else:
        advice = (
            "set camera.frame_rate_hz to the rate reached; an exposure longer than a frame, a "
            "dynamic frame rate in dim light, or a full USB bus slows a camera down"
        )
        yield Check("frame rate", "warning", finding, advice)
    lost_count = steps + 1 - len(read_frames)
    corrupt = sum(frame.is_corrupt for frame in read_frames)
    finding = f"{lost_count} lost and {corrupt} corrupt of {steps + 1}"
    if lost_count == 0 and corrupt == 0:
        yield Check("frames", "ok", finding)
    else:
        advice = (
            "give the camera its own USB or network port, a shorter cable, or a lower frame rate"
        )
        yield Check("frames", "warning", finding, advice)


def _check_kind(info: CameraInfo) -> Iterator[Check]:
    """Check the surroundings that an open camera of its kind needs, such as a network."""
    faults = CAMERA_KINDS[info.kind].faults
    if faults is not None:
        yield from (
            Check(fault.name, "warning", fault.message, fault.advice) for fault in faults(info)
        )


def exposure_range_ms(
    camera: Camera, listed: Sequence[ListedCamera], config: CameraConfig
) -> tuple[float, float]:
    """Shortest and longest exposure; OpenCV does not report the longest one, `listed` has it."""
    shortest_ms, longest_ms = camera.exposure_range_ms
    if not isinstance(config, DeviceCameraConfig):
        return shortest_ms, longest_ms
    limits = [
        entry.longest_exposure_ms
        for entry in listed
        if entry.longest_exposure_ms is not None and config.matches(entry)
    ]
    return shortest_ms, max(shortest_ms, min([longest_ms, *limits]))
