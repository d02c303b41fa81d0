"""`GenicamCamera`: a GigE Vision or USB3 Vision camera in measurement mode."""

import os
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rig.cameras.camera import CameraInfo, Frame, ListedCamera, require_exposure
from rig.errors import CameraError, CameraFault

from .aravis import (
    FRAME_ID_COUNT,
    FRAMES_IN_SOCKET,
    AravisCamera,
    Buffer,
    find_devices,
)
from .measurement_mode import (
    FIXED_FEATURES,
    GAMMA_SWITCHES,
    GenicamCameraConfig,
    set_exposure,
    set_measurement_mode,
)
from .pixel_formats import FAMILIES, PIXEL_FORMATS, decode

# Number of buffers, one of which is being filled. More would hold more stale frames after a switch.
_BUFFERS = 4
# Further features that change the pixel value of the same light.
_PIXEL_VALUES = (
    "BlackLevel", "BlackLevelRaw", "DigitalShift", "Sharpness", "Brightness", "Contrast",
    "BslBrightness", "BslContrast",
)  # fmt: skip
# Formats, best first: grey before colour; 12 bits, then 10, then others; packed before unpacked,
# because they need less bandwidth.
_PREFERRED_FORMATS = [
    f"{family}{packing}"
    for family in FAMILIES
    for packing in ("12p", "12Packed", "12", "10p", "10Packed", "10", "16", "8")
]


class GenicamCamera:
    """An open, streaming camera of which nothing adapts by itself and every value is read back."""

    def __init__(self, config: GenicamCameraConfig) -> None:
        config.require_measured_mode()
        self._config = config
        self._last_id: int | None = None
        self._sequence = 0
        self._clock = DeviceClock()
        self._camera = AravisCamera(config.device)
        try:
            self._camera.take_control()
            self._period_s = set_measurement_mode(self._camera, config)
            self._exposure_ms = self._camera.exposure_ms
            self._camera.start(_BUFFERS)
            self._name, self._controls = self._camera.name, self._record()
            self._pixel_values = _pixel_values(self._camera)
        except BaseException as error:
            self._camera.close()
            if type(error) is CameraError:  # Aravis does not name the camera
                raise CameraError(f"{config.device}: {error}") from error
            raise

    @property
    def info(self) -> CameraInfo:
        config = self._config
        return CameraInfo(
            kind="genicam",
            name=self._name,
            width_px=config.width_px,
            height_px=config.height_px,
            bit_depth=config.bits,
            frame_period_s=self._period_s,
            exposure_s=self._exposure_ms / 1e3,
            queue_length=_BUFFERS,
            readout_s=config.readout_s,
            start_uncertainty_s=config.start_uncertainty_s,
            controls=self._controls,
            **self._pixel_values,
        )

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        """Shortest and longest exposure that fits into a frame."""
        shortest_ms, longest_ms = self._camera.exposure_range_ms
        return shortest_ms, max(shortest_ms, min(longest_ms, 1e3 * self._period_s))

    def set_exposure(self, exposure_ms: float) -> None:
        require_exposure(exposure_ms, self.exposure_range_ms)
        set_exposure(self._camera, self._config, exposure_ms)
        self._exposure_ms = self._camera.exposure_ms

    def read(self, timeout_s: float) -> Frame:
        """The oldest frame in the queue, or the next one; with lost packets it is corrupt."""
        config = self._config
        buffer = self._camera.next_buffer(timeout_s)
        if buffer is None:
            raise CameraError(f"{config.device}: no frame in {timeout_s:g} s; {self._advice()}")
        exposure_s = self._exposure_ms / 1e3
        start_s = config.exposure_start_s(
            self._clock.stamp_s(buffer),
            claims_start=True,
            period_s=self._period_s,
            exposure_s=exposure_s,
        )
        size_px = (config.width_px, config.height_px)
        if not buffer.data:
            pixels = np.zeros(size_px[::-1], np.uint8 if config.bits == 8 else np.uint16)
        else:
            if buffer.size_px not in (size_px, (0, 0)):  # older cameras of FLIR state none
                raise CameraError(
                    f"{config.device}: a frame of {buffer.size_px[0]} x {buffer.size_px[1]} px "
                    f"instead of {size_px[0]} x {size_px[1]} px; open the camera again"
                )
            pixels = decode(config.pixel_format, buffer.data, *size_px)
        return Frame(
            pixels=pixels,
            bit_depth=config.bits,
            exposure_start_s=start_s,
            exposure_end_s=start_s + exposure_s,
            sequence=self._sequence_number(buffer.frame_id),
            is_corrupt=not buffer.data,
        )

    def close(self) -> None:
        self._camera.close()

    def _sequence_number(self, frame_id: int) -> int:
        """Sequence number of a frame, which continues when the camera's 16-bit id starts again."""
        if self._last_id is not None:
            self._sequence += (frame_id - self._last_id) % FRAME_ID_COUNT
        self._last_id = frame_id
        return self._sequence

    def _advice(self) -> str:
        try:
            self._camera.value("Width", int)
        except CameraError:
            return "the camera does not answer; check its cable and supply, and open it again"
        if self._config.trigger_line is not None:
            return f"it answers, but nothing triggers it at {self._config.trigger_line}"
        return "it answers, but sends nothing: open it again after a restart, or check the firewall"

    def _record(self) -> dict[str, Any]:
        """The camera's state for a set's metadata."""
        camera, config = self._camera, self._config
        kinds: dict[str, Any] = {name: type(value) for name, value in FIXED_FEATURES.items()}
        for name in ("DeviceVersion", "DeviceFirmwareVersion", "DeviceSerialNumber"):
            kinds[name] = str
        record: dict[str, Any] = {
            name: camera.value(name, kind) for name, kind in kinds.items() if camera.has(name)
        }
        record["genicam"] = {
            "device": config.device,
            "pixel_format": config.pixel_format,
            "trigger_line": config.trigger_line,
            **config.timing_record,
        }
        if camera.has("GevSCPSPacketSize"):
            record["genicam"]["packet_bytes"] = camera.value("GevSCPSPacketSize", int)
        if camera.has("GevLinkSpeed"):
            record["genicam"]["link_mbit_per_s"] = camera.number("GevLinkSpeed")
        return record


def _pixel_values(camera: AravisCamera) -> dict[str, Any]:
    """Gain, gamma and further values that change a pixel, as fields of `CameraInfo`."""
    gamma = camera.number("Gamma") if camera.has("Gamma") else None
    switches = [camera.value(name, bool) for name in GAMMA_SWITCHES if camera.has(name)]
    return {
        "gain": camera.gain,
        "gamma": 1.0 if switches and not any(switches) else gamma,
        "pixel_value_controls": {
            name: camera.number(name) for name in _PIXEL_VALUES if camera.has(name)
        },
    }


class DeviceClock:
    """Converts time stamps of the camera to the clock of this machine.

    The offset of the clocks is the least of the last frames, because readout and load only delay
    an arrival. A frame without a stamp gets the time of its arrival.
    """

    # Frames of some seconds: a camera's clock that is off by 50 ppm drifts by 0.5 ms in 10 s.
    _FRAMES = 256

    def __init__(self) -> None:
        self._offsets_s: deque[float] = deque(maxlen=self._FRAMES)

    def stamp_s(self, buffer: Buffer) -> float:
        """Monotonic time of a buffer's stamp."""
        now_s, utc_ns = time.monotonic(), time.time_ns()
        waited_s = (utc_ns - buffer.arrival_utc_ns) / 1e9 if buffer.arrival_utc_ns else 0.0
        arrival_s = now_s - max(waited_s, 0.0)
        if not buffer.device_ns:
            return arrival_s
        self._offsets_s.append(arrival_s - buffer.device_ns / 1e9)
        return buffer.device_ns / 1e9 + min(self._offsets_s)


def list_genicam_cameras() -> list[ListedCamera]:
    """List the cameras that answer on networks and USB; none without Aravis."""
    try:
        detected = find_devices()
    except CameraError:  # Aravis is not installed
        return []
    return [*map(_with_formats, detected), *_inaccessible_usb_cameras()]


USB_DEVICES = Path("/sys/bus/usb/devices")


def _inaccessible_usb_cameras() -> Iterator[ListedCamera]:
    """USB3 Vision cameras that this user may not open; Aravis passes over them."""
    for interface in USB_DEVICES.glob("*:*"):
        usb = USB_DEVICES / interface.name.partition(":")[0]
        try:
            values = [interface / f"bInterface{name}" for name in ("Class", "SubClass", "Protocol")]
            if [path.read_text().strip() for path in values] != ["ef", "05", "00"]:
                continue
            number = [int((usb / name).read_text()) for name in ("busnum", "devnum")]
            serial, name = ((usb / name).read_text().strip() for name in ("serial", "product"))
        except (OSError, ValueError):  # unplugged
            continue
        node = Path("/dev/bus/usb/{:03}/{:03}".format(*number))
        if not os.access(node, os.R_OK | os.W_OK):
            problem = f"{name} {serial}: you may not read and write {node}"
            yield ListedCamera("genicam", serial, name, "USB3Vision", node, problem=problem)


def _with_formats(detected: ListedCamera) -> ListedCamera:
    """Open a camera to ask for its formats and its longest exposure."""
    try:
        camera = AravisCamera(detected.device)
    except CameraError as error:
        return replace(detected, problem=f"{detected.device}: {error}")
    try:
        formats = camera.entries("PixelFormat")
        best = next((name for name in _PREFERRED_FORMATS if name in formats), None)
        lines: tuple[str, ...] = ()
        if best is not None:
            width_px, height_px = camera.value("Width", int), camera.value("Height", int)
            lines = (
                f'pixel_format = "{best}"',
                f"width_px = {width_px}",
                f"height_px = {height_px}",
            )
        longest_ms = camera.exposure_range_ms[1]
        return replace(
            detected, formats=tuple(formats), longest_exposure_ms=longest_ms, config_lines=lines
        )
    except CameraError as error:
        return replace(detected, problem=f"{detected.device}: {error}")
    finally:
        camera.close()


MAX_BUFFER_FILE = Path("/proc/sys/net/core/rmem_max")
# Share of a link's rate that remains for pixels beside the headers of packets: 115 MB/s of gigabit
# Ethernet.
_PIXEL_SHARE = 0.92
# Number of packets of 1,500 bytes that the kernel handles per second on two cores without losses.
_MAX_PACKETS_PER_S = 40_000


def network_faults(info: CameraInfo) -> Iterator[CameraFault]:
    """Rate, packets and buffers that do not suffice for the frames of an open camera."""
    record = info.controls["genicam"]
    if "packet_bytes" not in record:
        return  # not in a network
    bits = PIXEL_FORMATS[record["pixel_format"]].bits_in_memory
    frame_bytes = info.width_px * info.height_px * bits // 8
    rate_mb_per_s = frame_bytes / info.frame_period_s / 1e6
    max_mb_per_s = _PIXEL_SHARE * (record.get("link_mbit_per_s") or 1000.0) / 8.0
    if rate_mb_per_s > max_mb_per_s:
        yield CameraFault(
            "network rate",
            f"frames of {frame_bytes / 1e6:.1f} MB at {1.0 / info.frame_period_s:g} Hz are "
            f"{rate_mb_per_s:.0f} MB/s, the camera's link carries {max_mb_per_s:.0f}",
            "lower camera.frame_rate_hz, or choose a packed camera.pixel_format",
        )
    packet_bytes = record["packet_bytes"]
    packets_per_s = 1e6 * rate_mb_per_s / packet_bytes
    if packets_per_s > _MAX_PACKETS_PER_S:
        yield CameraFault(
            "packet size",
            f"{packets_per_s:.0f} packets of {packet_bytes} bytes a second",
            "allow large packets: sudo ip link set IFACE mtu 9000",
        )
    needed_bytes = FRAMES_IN_SOCKET * frame_bytes
    try:
        max_bytes = int(MAX_BUFFER_FILE.read_text())
    except (OSError, ValueError):
        return  # not Linux
    if max_bytes < needed_bytes:
        yield CameraFault(
            "socket buffer",
            f"a socket may hold {max_bytes} bytes, {FRAMES_IN_SOCKET} frames are {needed_bytes}",
            f"sudo sysctl -w net.core.rmem_max={needed_bytes}",
        )
